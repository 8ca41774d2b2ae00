"""The systemd units of a board: shipped templates, each with a drop-in that the mission adds for this board."""

from __future__ import annotations

from dataclasses import dataclass

from argosy.deploy.board_needs import Reach, reach_of_robots, reaches_machines
from schemas.files.shipped_files import shipped
from schemas.mission.model import Mission

VENV = "/opt/argosy"
"""Virtual environment on a board, as in the templates."""
UNITS = "etc/systemd/system"
WATCHDOG = 10.0
"""Watchdog period in seconds, as in the templates."""
_HEADER = (
    "# Written by `argosy units` from the mission file: change the mission, or add a file of your own beside this.\n"
)
_NO_NETWORK = "PrivateNetwork=yes\nIPAddressDeny=any\nRestrictAddressFamilies=\nRestrictAddressFamilies=AF_UNIX\n"


@dataclass(frozen=True)
class Board:
    """A board of a mission, and how Argosy runs there."""

    mission: Mission
    name: str
    venv: str = VENV
    one_process: bool = False

    @property
    def folder(self) -> str:
        """Folder of the mission's files and keys on the board."""
        return f"/etc/argosy/{self.mission.name}"

    @property
    def file(self) -> str:
        """The mission file."""
        return f"{self.folder}/{self.mission.path.name}"

    @property
    def socket(self) -> str:
        """The router's socket, in a folder for members of the group `argosy`."""
        return f"/run/argosy/{self.mission.name}/router.sock"

    @property
    def router(self) -> str:
        """Endpoint of the board's router for its daemons and members of the group."""
        return f"unixsock-stream/{self.socket}"

    @property
    def target(self) -> str:
        """The target that starts all of them."""
        return f"argosy-{self.mission.name}.target"

    @property
    def keys(self) -> str | None:
        """The folder of its keys; None if it has no link to another machine."""
        return f"{self.folder}/keys" if reaches_machines(self.mission, self.name) else None

    @property
    def daemons(self) -> tuple[str, ...]:
        """Names of the templates that run there."""
        if self.one_process:
            return ("board",)
        robots = ("bridged",) if self.mission.robots_on(self.name) else ()
        return ("commd", *robots, *(("agentd",) if self.mission.agents_on(self.name) else ()))

    @property
    def units(self) -> tuple[str, ...]:
        """The services that run there."""
        return tuple(f"{daemon}@{self.mission.name}.service" for daemon in self.daemons)

    def user(self, daemon: str) -> str:
        """Return the user of a daemon."""
        return f"argosy-{daemon}"


def unit_files(board: Board) -> dict[str, str]:
    """Return the units and the files they need to start, by path below the board's root.

    Raises Findings for a manifest that cannot be read.
    """
    what = f"Argosy: mission {board.mission.name}, board {board.name}"
    wants = f"Wants={' '.join(board.units)}\n\n[Install]\nWantedBy=multi-user.target\n"
    files = {f"{UNITS}/{board.target}": f"{_HEADER}[Unit]\nDescription={what}\n{wants}"}
    for daemon, unit in zip(board.daemons, board.units, strict=True):
        files[f"{UNITS}/{daemon}@.service"] = _template(f"{daemon}@.service").replace(VENV, board.venv)
        if added := _added(board, daemon):
            files[f"{UNITS}/{unit}.d/board.conf"] = f"{_HEADER}[Service]\n{added}"
    files["etc/sysusers.d/argosy.conf"] = _template("argosy.sysusers")
    files[f"etc/tmpfiles.d/argosy-{board.mission.name}.conf"] = _tmpfiles(board)
    values = {"MISSION": board.file, "BOARD": board.name, "ROUTER": board.router}
    files[f"{board.folder[1:]}/board.env"] = _HEADER + "".join(f"{name}={value}\n" for name, value in values.items())
    return files


def _template(name: str) -> str:
    path = shipped("deploy", f"systemd/{name}")
    if path is None:
        raise FileNotFoundError(f"systemd/{name} does not ship with this installation")
    return path.read_text(encoding="utf-8")


def _tmpfiles(board: Board) -> str:
    """Return the file modes below /etc/argosy: all daemons read the mission, only the router reads the keys."""
    router = board.user("board" if board.one_process else "commd")
    lines = [
        "z /etc/argosy 0755 root root",
        f"z {board.folder} 0750 root argosy",
        f"Z {board.folder}/keys ~0700 {router} argosy",
    ]
    return _HEADER + "".join(f"{line}\n" for line in lines)


def _added(board: Board, daemon: str) -> str:
    """Return the drop-in of a template: watchdog period, devices and addresses of this board."""
    machines = Reach(hosts=None) if reaches_machines(board.mission, board.name) else Reach()
    if daemon == "agentd":
        return _patience(board)
    if daemon == "commd":
        return _allowing(machines)
    robots = reach_of_robots(board.mission, board.name)
    if daemon == "board" and machines.hosts is None:
        robots = Reach(robots.devices, None, robots.unknown)
    text = "what its driver needs is not known here; devices are allowed by DeviceAllow= in a file of yours."
    unknown = f"# {', '.join(robots.unknown)}: {text}\n" if robots.unknown else ""
    return (_patience(board) if daemon == "board" else "") + unknown + _allowing(robots)


def _patience(board: Board) -> str:
    """Return a watchdog period longer than the `agent_silence` that the mission allows."""
    agents = (board.mission.agents[name].robot for name in board.mission.agents_on(board.name))
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
