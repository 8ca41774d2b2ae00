"""The same under a real systemd: the units that `argosy units` writes, with all that they may not, in flight."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Literal

from argosy.deploy.unit_files import Board
from argosy.deploy.units_command import write
from schemas.mission.model import load_mission
from tests.field.agents import HOLD, STOPPED, WATCHDOG, returned
from tests.field.bridges import FAILSAFE, ROUTER_STOPPED, goes_on
from tests.field.flight import Flight
from tests.field.rows import MARGIN, Maker, Row, row_of
from tests.support.booted import booted
from tests.support.processes import Daemon

Which = Literal["commd", "bridged", "agentd", "board"]
_MISSION = """\
mission: field
agents: {uav: {program: uav.asl, robot: uav1}}
robots:
  uav1: {manifest: copter, link: "udpin:127.0.0.1:14550", GCSon_agent_loss: [hold 5s, rtl]}
"""
_PROGRAM = """\
!go.
+!go <- set_mode("GUIDED"); arm_motors(true); takeoff(10); .print("on its way"); goto(-27.594, -48.508, 30).
-!go[reason(R)] <- .print("goto failed: ", R).
+restarted(N) <- .wait(state(_, true, true)); set_mode("GUIDED"); goto(-27.594, -48.508, 30).
"""
_UP = 90.0


class Booted(Flight):
    """A machine with its own systemd, on which a copter flies by the units of its board."""

    def __init__(self, folder: Path, *, failsafe: bool = False, one_process: bool = False) -> None:
        (folder / "uav.asl").write_text(_PROGRAM)
        (folder / "field.yaml").write_text(_MISSION.replace("GCS", "failsafe: {gcs: bridge}, " if failsafe else ""))
        self._board = Board(load_mission(folder / "field.yaml"), "local", one_process=one_process)
        write(self._board, folder / "tree")
        self._tree, self._parameters = folder / "tree", ("FS_GCS_ENABLE=1",) if failsafe else ()
        self._stack = ExitStack()

    def __enter__(self) -> Booted:
        with ExitStack() as stack:
            self.machine = stack.enter_context(booted())
            self.machine.install(self._tree)
            python = self.machine.command("sh", "-c", 'cd /opt/checkout; shift; exec /opt/argosy/bin/python "$@"', "sh")
            link = ("udpout:127.0.0.1:14550", "1", *self._parameters)
            self.vehicle = Daemon("tests.field.vehicle", *link, within=python)
            stack.callback(self.vehicle.kill)
            self.machine.run("systemctl", "start", self._board.target, *self._board.units, seconds=_UP)
            self.until(lambda: "on its way" in self.machine.journal(), "the copter is on its way", _UP)
            time.sleep(2.0)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def unit(self, daemon: Which) -> str:
        """The unit of a daemon."""
        return f"{daemon}@{self._board.mission.name}.service"

    def kill(self, daemon: Which, signal: Literal["KILL", "STOP"]) -> float:
        """Send a signal to the process of a unit; returns when."""
        pid, at = self.machine.main_pid(self.unit(daemon)), time.monotonic()
        self.machine.run("kill", f"-{signal}", str(pid))
        return at

    def ended(self, daemon: Which, pid: int, at: float) -> tuple[float, float]:
        """Wait until systemd has ended a process and the unit is ready again; returns both, in seconds after `at`."""
        unit = self.unit(daemon)
        self.machine.until(lambda: self.machine.main_pid(unit) != pid, f"{daemon} is ended")
        ended = time.monotonic() - at
        serves = ("active", "running")
        state = lambda: (self.machine.show(unit, "ActiveState"), self.machine.show(unit, "SubState"))  # noqa: E731
        self.machine.until(lambda: state() == serves and self.machine.main_pid(unit) not in (0, pid), "ready again")
        return ended, time.monotonic() - at

    def transcript(self) -> str:
        """All that was said."""
        return f"{self.machine.journal()}\n{self.vehicle.text}"


def flown_by_units(
    fault: str, injected: str, *, failsafe: bool = False, one_process: bool = False
) -> Callable[[Callable[[Row, Booted], None]], Maker]:
    """Make a row of what is done to a copter that flies by the units of its board."""
    return row_of(fault, injected, lambda folder: Booted(folder, failsafe=failsafe, one_process=one_process))


@flown_by_units("agentd, killed", "SIGKILL, under a real systemd")
def agent_killed(row: Row, scene: Booted) -> None:
    """agentd is killed; systemd starts it again."""
    pid = scene.machine.main_pid(scene.unit("agentd"))
    at = scene.kill("agentd", "KILL")
    returned(row, scene, at, scene.ended("agentd", pid, at)[1])


@flown_by_units("agentd, stopped", "SIGSTOP, under a real systemd")
def agent_stopped(row: Row, scene: Booted) -> None:
    """agentd is stopped; systemd's watchdog ends it."""
    pid = scene.machine.main_pid(scene.unit("agentd"))
    at = scene.kill("agentd", "STOP")
    row.figure("hold", scene.until_shown("BRAKE", at), *STOPPED)
    watched(row, scene, "agentd", pid, at)
    row.figure("flown by its program again", scene.until_shown("GUIDED", at))
    if (rtl := scene.shows("RTL", at)) is not None:  # due when the watchdog is: an agent that is back is waited for
        row.figure("rtl", rtl, STOPPED[0] + HOLD, f"and `hold {HOLD:g}s`")


@flown_by_units("bridged, stopped", "SIGSTOP, under a real systemd; `failsafe: {gcs: bridge}`", failsafe=True)
def bridge_stopped(row: Row, scene: Booted) -> None:
    """bridged is stopped; the vehicle's own failsafe acts, systemd's watchdog ends the bridge."""
    pid = scene.machine.main_pid(scene.unit("bridged"))
    at = scene.kill("bridged", "STOP")
    row.figure("rtl", scene.until_shown("RTL", at), *FAILSAFE)
    watched(row, scene, "bridged", pid, at)


@flown_by_units("commd, stopped", "SIGSTOP, under a real systemd")
def router_stopped(row: Row, scene: Booted) -> None:
    """commd is stopped; systemd's watchdog ends it."""
    pid = scene.machine.main_pid(scene.unit("commd"))
    at = scene.kill("commd", "STOP")
    row.figure("hold", scene.until_shown("BRAKE", at), *ROUTER_STOPPED)
    watched(row, scene, "commd", pid, at)


@flown_by_units(
    "argosy board, killed", "SIGKILL, under a real systemd; `failsafe: {gcs: bridge}`", failsafe=True, one_process=True
)
def board_killed(row: Row, scene: Booted) -> None:
    """The one process of a board is killed; systemd starts it again."""
    pid = scene.machine.main_pid(scene.unit("board"))
    at = scene.kill("board", "KILL")
    row.figure("ready again", scene.ended("board", pid, at)[1])
    time.sleep(8)
    goes_on(row, scene, at)


def watched(row: Row, scene: Booted, daemon: Which, pid: int, at: float) -> None:
    """Note when systemd has ended a daemon that hangs, and when its unit is ready again."""
    ended, ready = scene.ended(daemon, pid, at)
    row.figure("ended by its watchdog", ended)
    row.expect(ended <= WATCHDOG + MARGIN, f"the watchdog finds it within {WATCHDOG:g} s")
    row.figure("ready again", ready)


SYSTEMD: tuple[Maker, ...] = (agent_killed, agent_stopped, bridge_stopped, router_stopped, board_killed)
"""Rows that boot a machine of their own."""
