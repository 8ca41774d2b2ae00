"""`argosy units`: write the files that a board needs to run its part of a mission under systemd, as a tree for `/`."""

from __future__ import annotations

import posixpath
import re
import sys
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from shlex import quote
from tempfile import TemporaryDirectory

from argosy.check.command import check_mission
from argosy.check.fleet_rules import AFTER_RESTART
from argosy.cli.errors import BadInput, CommandError
from argosy.deploy.board_needs import files_of, reach_of_robots, secrets_of
from argosy.deploy.firewall import firewall_files, firewall_unit, reachable, rules_path
from argosy.deploy.unit_files import VENV, Board, unit_files
from argosy.processes.simulators import require_links
from commd.daemon import chosen
from commd.process.process import EXIT_DONE
from commd.router import config
from schemas.files.findings import Findings
from schemas.mission.model import Mission, load_mission

GUIDE = "INSTALL.md"
TAKEN = {"router.json5", "board.env", "firewall.nft", "keys"}
"""Names beside the mission's files on a board."""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy units`."""
    parser.add_argument("mission", help="mission file")
    parser.add_argument("--board", help="board to write files for (default: the only one)")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="new folder to write")
    parser.add_argument("--one-process", action="store_true", help="run `argosy board` instead of three daemons")
    text = f"folder of Argosy's virtual environment on the board (default: {VENV})"
    parser.add_argument("--venv", type=_venv, default=VENV, metavar="DIR", help=text)


def run(args: Namespace) -> int:
    """Write the tree. Raises Findings for an unsuitable mission, CommandError if the folder cannot be written."""
    mission = load_mission(args.mission)
    board = Board(mission, chosen(mission, args.board), args.venv, args.one_process)
    try:
        written = write(board, args.out)
    except FileExistsError:
        raise BadInput(
            f"{args.out} is not empty: name a new folder, as files of an older mission must not stay"
        ) from None
    except OSError as error:
        raise CommandError(f"{error.filename or args.out}: {error.strerror or error}") from None
    for finding in check_mission(args.mission, restarts=True)[1]:
        if finding.kind == AFTER_RESTART:  # systemd starts every daemon again
            print(finding, file=sys.stderr)
    units = ", ".join((board.target, *board.units))
    print(f"{args.out}: {written} files for board {board.name}: {units}\nwhat to do with them: {args.out / GUIDE}")
    return EXIT_DONE


def write(board: Board, out: Path) -> int:
    """Write all files of a board, or none if one of them is impossible. Returns their number.

    Raises Findings, FileExistsError for a folder that is not empty, and OSError.
    """
    check(board.mission)
    secrets = secrets_of(board.mission, board.name)
    _check_secrets(board.mission, secrets)
    texts: dict[str, str | bytes] = dict(unit_files(board) | firewall_files(board))
    keys = None if board.keys is None else Path(board.keys)
    settings = config.router_settings(board.mission, board.name, socket=board.socket, keys=keys)
    texts[f"{board.folder[1:]}/router.json5"] = config.write(settings)
    for name, path in files_of(board.mission, board.name).items():
        if Path(name).parts[0] in TAKEN:
            raise Findings.about(path, "a board has another file of this name: rename the mission's")
        texts[f"{board.folder[1:]}/{name}"] = path.read_bytes()
    texts[GUIDE] = guide(board, secrets)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise FileExistsError
    there = out.exists()
    try:
        out.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=out) as new:  # a part of the files would be taken for the board's
            _write(Path(new), texts)
            for part in dict.fromkeys(Path(name).parts[0] for name in texts):
                (Path(new) / part).rename(out / part)
        out.chmod(0o755)
    except BaseException as error:
        if isinstance(error, OSError):
            error.filename = str(out)  # a user did not name the folder in it
        if not there:
            with suppress(OSError):
                out.rmdir()
        raise
    return len(texts)


def _write(out: Path, texts: Mapping[str, str | bytes]) -> None:
    for name, text in texts.items():
        target = out / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(text if isinstance(text, bytes) else text.encode())
        target.chmod(0o644)
        for folder in target.relative_to(out).parents:  # daemons of other users read them, whatever our umask is
            (out / folder).chmod(0o755)


def check(mission: Mission) -> None:
    """Raise Findings for a mission that units cannot run."""
    if mission.router.external:
        text = "router.external: the units run commd as the board's router; leave it out"
        raise Findings([mission.positions.finding(("router", "external"), text)])
    require_links(mission)
    name = mission.path.name
    if not name.isprintable() or name != name.strip() or set(name) & set("\"'\\`$%#;"):
        text = "expected a file name without quotes, control characters and ` \\ $ % # ;: units name it"
        raise Findings.about(mission.path, text)


def _check_secrets(mission: Mission, secrets: Sequence[str]) -> None:
    for name in secrets:
        if not name.isprintable():
            text = f"expected the name of a file without control characters, got {name!r}"
            where = next(
                robot for robot, its in mission.robots.items() if its.signing and its.signing.passphrase_file == name
            )
            raise Findings([mission.positions.finding(("robots", where, "signing", "passphrase_file"), text)])


def _venv(text: str) -> str:
    if not re.fullmatch(r"/[A-Za-z0-9_./+-]+", text) or ".." in text.split("/"):
        raise ArgumentTypeError(f"expected an absolute path without blanks and `..`, got `{text}`")
    if text.startswith(("/home/", "/root/", "/run/user/", "/tmp/", "/var/tmp/")):  # noqa: S108  to refuse them
        raise ArgumentTypeError(f"the daemons do not see {text}: install below /opt, /usr or /srv")
    return text.rstrip("/")


def guide(board: Board, secrets: Sequence[str]) -> str:
    """Return the installation page. `secrets`: files with passphrases of its robots."""
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
    places = [  # one with an absolute path is expected beside the tree
        (posixpath.basename(name) if posixpath.isabs(name) else name, posixpath.join(board.folder, name))
        for name in secrets
    ]
    install = f"sudo install -D -m 0600 -o {user} -g argosy --"
    lines = [f"{install} {quote(here)} {quote(there)}" for here, there in places]
    return ["Passphrases are not copied by `argosy units`:\n", _block(*lines)]


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
