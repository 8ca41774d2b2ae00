"""What to do on a board with the files that `argosy units` has written, as a page for it."""

from __future__ import annotations

import posixpath
from collections.abc import Sequence
from shlex import quote

from argosy.deploy.device_access import reach_of_robots
from argosy.deploy.firewall import firewall_unit, reachable, rules_path
from argosy.deploy.unit_files import Board


def guide(board: Board, secrets: Sequence[str]) -> str:
    """Return the page. `secrets` are the files with passphrases that its robots need."""
    mission, target = board.mission.name, board.target
    parts = [
        f"# {mission}: board {board.name}\n",
        f"Argosy is installed in `{board.venv}` on the board (docs/start/install.md). "
        "Copy this folder to the board, and there, in it:\n",
        _block(
            "chmod -R u=rwX,go=rX etc  # whatever the umask was: nothing here is secret",
            "sudo cp -rT --preserve=mode etc /etc",
            "sudo systemd-sysusers",
            f"sudo systemd-tmpfiles --create argosy-{mission}.conf",
            "sudo systemctl daemon-reload",
        ),
        *_keys(board),
        *_secrets(board, secrets),
        *_unknown(board),
        "Start it, now and whenever the board is switched on:\n",
        _block(f"sudo systemctl enable --now {target}", f"systemctl status {' '.join(board.units)}"),
        *_firewall(board),
        f"The router is at `{board.router}`, for the group `argosy`. **Who joins it** (`sudo usermod -aG argosy USER`) "
        "may act as every agent and robot of this board, and stop its robots: its operators, nobody else. Whoever only "
        "watches gets an observer's keys (`argosy keys add-observer`, docs/guides/security.md).\n",
        "Stop it; a robot that is armed is left as `on_shutdown` says first:\n",
        _block(f"sudo systemctl stop {target}"),
    ]
    return "\n".join(parts)


def _block(*lines: str) -> str:
    return "\n".join(("```sh", *lines, "```\n"))


def _keys(board: Board) -> list[str]:
    if board.keys is None:
        return ["It is linked to no other machine, and needs no keys.\n"]
    text = (
        f"Its keys are the folder `machines/{board.name}` that `argosy keys init` has made "
        "(docs/guides/security.md); copy it to the board as `keys`. Only the router reads them:\n"
    )
    again = f"sudo systemd-tmpfiles --create argosy-{board.mission.name}.conf"
    return [text, _block(f"sudo cp -rT keys {board.keys}", again, "rm -r keys")]


def _secrets(board: Board, secrets: Sequence[str]) -> list[str]:
    if not secrets:
        return []
    user = board.user("board" if board.one_process else "bridged")
    places = [(_here(name), posixpath.join(board.folder, name)) for name in secrets]
    install = f"sudo install -D -m 0600 -o {user} -g argosy --"
    lines = [f"{install} {quote(here)} {quote(there)}" for here, there in places]
    return ["Passphrases are not copied by `argosy units`:\n", _block(*lines)]


def _here(secret: str) -> str:
    """Where a file with a passphrase is before it is installed: one with a place of its own comes beside the tree."""
    return posixpath.basename(secret) if posixpath.isabs(secret) else secret


def _firewall(board: Board) -> list[str]:
    if not reachable(board):
        return []
    text = (
        f"Firewall rules in front of the router are off until you enable them. Read `{rules_path(board)}`; they need "
        "`nft` (`sudo apt-get install nftables`), and limit new connections to the router's port alone:\n"
    )
    return [text, _block(f"sudo systemctl enable --now {firewall_unit(board)}")]


def _unknown(board: Board) -> list[str]:
    robots = reach_of_robots(board.mission, board.name).unknown
    if not robots:
        return []
    unit = board.units[0] if board.one_process else f"bridged@{board.mission.name}.service"
    text = f"What the drivers of {', '.join(robots)} need is not known here. Allow devices by `sudo systemctl edit"
    return [f"{text} {unit}`: `[Service]`, `PrivateDevices=no`, `DeviceAllow=/dev/NAME rw`.\n"]
