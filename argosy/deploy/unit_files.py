"""The units of a board: the templates that ship, and beside each what the mission adds to it for this board."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from argosy.deploy.board_needs import Reach, agents_of, reach_of_robots, reaches_machines, robots_of
from schemas.files.shipped_files import shipped
from schemas.mission.model import Mission

VENV = "/opt/argosy"
"""Where Argosy is installed on a board, as the templates say it."""
UNITS = "etc/systemd/system"
WATCHDOG = 10.0
"""Seconds, as the templates say them."""
_HEADER = (
    "# Written by `argosy units` from the mission file: change the mission, or add a file of your own beside this.\n"
)
_NO_NETWORK = "PrivateNetwork=yes\nIPAddressDeny=any\nRestrictAddressFamilies=\nRestrictAddressFamilies=AF_UNIX\n"


@dataclass(frozen=True)
class Board:
    """A board of a mission, and how Argosy is to run there."""

    mission: Mission
    name: str
    venv: str = VENV
    one_process: bool = False

    @property
    def folder(self) -> str:
        """What the mission has on the board, its keys among it."""
        return f"/etc/argosy/{self.mission.name}"

    @property
    def file(self) -> str:
        """The mission file."""
        return f"{self.folder}/{self.mission.path.name}"

    @property
    def socket(self) -> str:
        """The router's socket, in a folder that members of the group `argosy` may enter."""
        return f"/run/argosy/{self.mission.name}/router.sock"

    @property
    def router(self) -> str:
        """The endpoint of the board's router for its daemons, and for members of the group."""
        return f"unixsock-stream/{self.socket}"

    @property
    def target(self) -> str:
        """The unit that stands for all of them."""
        return f"argosy-{self.mission.name}.target"

    @property
    def keys(self) -> str | None:
        """The folder of its keys; None if it is linked to no other machine."""
        return f"{self.folder}/keys" if reaches_machines(self.mission, self.name) else None

    @property
    def daemons(self) -> tuple[str, ...]:
        """The templates whose instances run there."""
        if self.one_process:
            return ("board",)
        robots = ("bridged",) if robots_of(self.mission, self.name) else ()
        return ("commd", *robots, *(("agentd",) if agents_of(self.mission, self.name) else ()))

    @property
    def units(self) -> tuple[str, ...]:
        """The services that run there."""
        return tuple(f"{daemon}@{self.mission.name}.service" for daemon in self.daemons)

    def user(self, daemon: str) -> str:
        """Who a daemon runs as."""
        return f"argosy-{daemon}"


def unit_files(board: Board) -> dict[str, str]:
    """Return the texts of units and of what they need to start, by path below the board's root.

    Raises Findings for a manifest that cannot be read.
    """
    files = {f"{UNITS}/{board.target}": _target(board)}
    for daemon, unit in zip(board.daemons, board.units, strict=True):
        files[f"{UNITS}/{daemon}@.service"] = _template(f"{daemon}@.service").replace(VENV, board.venv)
        if added := _added(board, daemon):
            files[f"{UNITS}/{unit}.d/board.conf"] = f"{_HEADER}[Service]\n{added}"
    files["etc/sysusers.d/argosy.conf"] = _template("argosy.sysusers")
    files[f"etc/tmpfiles.d/argosy-{board.mission.name}.conf"] = _tmpfiles(board)
    files[f"{board.folder[1:]}/board.env"] = _environment(board)
    return files


def _template(name: str) -> str:
    path = shipped("deploy", f"systemd/{name}")
    if path is None:
        raise FileNotFoundError(f"systemd/{name} does not ship with this installation")
    return path.read_text(encoding="utf-8")


def _target(board: Board) -> str:
    what = f"Argosy: mission {board.mission.name}, board {board.name}"
    wants = " ".join(board.units)
    return f"{_HEADER}[Unit]\nDescription={what}\nWants={wants}\n\n[Install]\nWantedBy=multi-user.target\n"


def _environment(board: Board) -> str:
    values = {"MISSION": board.file, "BOARD": board.name, "ROUTER": board.router}
    return _HEADER + "".join(f"{name}={value}\n" for name, value in values.items())


def _tmpfiles(board: Board) -> str:
    """Who may read what is below /etc/argosy: the mission its daemons, the keys the router alone."""
    router = board.user("board" if board.one_process else "commd")
    lines = [
        "z /etc/argosy 0755 root root",
        f"z {board.folder} 0750 root argosy",
        f"Z {board.folder}/keys ~0700 {router} argosy",
    ]
    return _HEADER + "".join(f"{line}\n" for line in lines)


def _added(board: Board, daemon: str) -> str:
    """What a mission adds to a template: patience, and the devices and addresses that its daemons reach here."""
    machines = Reach(hosts=None) if reaches_machines(board.mission, board.name) else Reach()
    if daemon == "agentd":
        return _patience(board)
    if daemon == "commd":
        return _allowing(machines)
    robots = reach_of_robots(board.mission, board.name)
    if daemon == "board" and machines.hosts is None:
        robots = Reach(robots.devices, None, robots.unknown)
    return (_patience(board) if daemon == "board" else "") + _unknown(robots.unknown) + _allowing(robots)


def _patience(board: Board) -> str:
    """The watchdog must not end a mind that the mission allows to be busy for so long."""
    agents = (board.mission.agents[name].robot for name in agents_of(board.mission, board.name))
    silences = [float(board.mission.robots[robot].agent_silence) for robot in agents if robot is not None]
    wanted = 2 * max(silences, default=0.0)
    return f"WatchdogSec={wanted:g}\n" if wanted > WATCHDOG else ""


def _allowing(reach: Reach) -> str:
    lines = ""
    if reach.devices:
        lines += "PrivateDevices=no\nSupplementaryGroups=dialout\n"
        lines += "".join(f"DeviceAllow={device} rw\n" for device in reach.devices)
    if reach.hosts == ():
        lines += _NO_NETWORK
    elif reach.hosts is not None:
        lines += "IPAddressDeny=any\n" + "".join(f"IPAddressAllow={host}\n" for host in reach.hosts)
    return lines


def _unknown(robots: Sequence[str]) -> str:
    if not robots:
        return ""
    names = ", ".join(robots)
    return (
        f"# {names}: what its driver needs is not known here; devices are allowed by DeviceAllow= in a file of yours.\n"
    )


def templates() -> list[Path]:
    """Return the templates that ship."""
    names = ("commd", "bridged", "agentd", "board")
    return [path for name in names if (path := shipped("deploy", f"systemd/{name}@.service")) is not None]
