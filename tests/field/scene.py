"""A copter in flight, its daemons under a service manager, and what the vehicle itself shows when one of them fails.

Times are the machine's monotonic seconds; the vehicle flies in real time unless a test hurries it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from tests.boards.network import GROUND, Network
from tests.field.flight import Flight
from tests.field.rows import Maker, Row, row_of
from tests.field.units import Managed, UnitFile
from tests.support.ports import free_port
from tests.support.processes import Daemon

UP = 60.0
"""Seconds until everything is up and the copter is on its way."""
_MISSION = """\
mission: field
{boards}agents:
  uav: {{program: uav.asl, robot: uav1, board: {agent}}}
robots:
  uav1:
    board: {robot}
    manifest: copter
    link: udpin:{at}:{port}
    failsafe: {{gcs: {gcs}}}
    on_agent_loss: {on_agent_loss}
    on_shutdown: rtl
    simulate: {{home: [-27.604033, -48.518363, 21.0]}}
{router}"""
PROGRAM = """\
!go.
+!go <- !up; !on.
+!up <- set_mode("GUIDED"); arm_motors(true); takeoff(10).
+!on <- .print("on its way"); !!listen; goto(-27.594, -48.508, 30).
-!on[reason(R)] <- .print("goto failed: ", R).
+!listen <- .wait(100); hang.if_asked; !!listen.
+bridge(up) <- .print("bridge up").
-bridge(up) <- .print("bridge lost").
+restarted(N) <- .print("restarted ", N); .wait(state(_, true, true)); !again.
+!again <- set_mode("GUIDED"); .print("goes on"); !!listen; goto(-27.594, -48.508, 30).
-!again[reason(R)] <- .print("cannot go on: ", R).
"""
_HANG = """\
import os, time
from agentd import internal_action

@internal_action("hang.if_asked", 0)
def if_asked(mind, trail):
    if os.path.exists(os.environ["HANG"]):
        os.remove(os.environ["HANG"])
        print("hangs", flush=True)
        while True:
            time.sleep(1)
    return True
"""


class Scene(Flight):
    """The daemons of one copter: on this machine, or on the two boards of a network."""

    def __init__(
        self,
        folder: Path,
        *,
        boards: Sequence[str] = (),
        one_process: bool = False,
        on_agent_loss: str = "[hold 5s, rtl]",
        failsafe: bool = False,
        restart: bool = True,
        watchdog: bool = True,
        speed: float = 1.0,
    ) -> None:
        """With `boards` these are a network of their own, the agent on pi1 and the robot on pi2, else both are on one
        board. With `failsafe` the vehicle comes home by itself when it misses the heartbeats of the bridge."""
        self.folder, self.speed = folder, speed
        self.daemons: dict[str, Managed] = {}
        """commd, bridged and agentd, or board; with a network commd-pi1 and commd-pi2."""
        self._stack = ExitStack()
        self._network = Network(boards) if boards else None
        self._parameters = ("FS_GCS_ENABLE=1",) if failsafe else ()
        self._restart, self._watchdog, self._one_process = restart, watchdog, one_process
        port, network, named = free_port(), self._network, ""
        if network is not None:
            addresses = ", ".join(f"{name}: {{address: {address}}}" for name, address in network.addresses.items())
            named = f"boards: {{{addresses}}}\n"
        self._router = f"tcp/127.0.0.1:{free_port()}"
        self._link = f"udpout:{network.addresses['pi2'] if network else '127.0.0.1'}:{port}"
        (folder / "uav.asl").write_text(PROGRAM)
        (folder / "field.yaml").write_text(
            _MISSION.format(
                boards=named,
                agent="pi1" if network else "local",
                robot="pi2" if network else "local",
                gcs="bridge" if failsafe else "none",
                at="0.0.0.0" if network else "127.0.0.1",
                port=port,
                on_agent_loss=on_agent_loss,
                router=f"router: {{endpoint: {self._router}}}\n",
            )
        )
        site = folder / "site"
        info = site / "hang-1.0.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: hang\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text("[argosy.internal_actions]\nhang = hang_for_agents\n")
        (site / "hang_for_agents.py").write_text(_HANG)
        self._environment = {"PYTHONPATH": str(site), "HANG": str(folder / "hang"), "PYTHONDONTWRITEBYTECODE": "1"}

    def __enter__(self) -> Scene:
        try:
            self._up()
        except BaseException:
            self._stack.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def network(self) -> Network:
        """The cables between its boards."""
        assert self._network is not None
        return self._network

    def _up(self) -> None:
        if self._network is not None:
            self._stack.enter_context(self._network)
        ground = self._network.within(GROUND) if self._network else ()
        self.vehicle = Daemon("tests.field.vehicle", self._link, f"{self.speed:g}", *self._parameters, within=ground)
        self._stack.callback(self.vehicle.kill)
        file, speed = str(self.folder / "field.yaml"), ("--speed", f"{self.speed:g}")
        if self._one_process:
            self._start("board", "board", ("argosy", "board", file, *speed))
        elif self._network is None:
            self._start("commd", "commd", ("commd", "serve", file))
            self._start("bridged", "bridged", ("bridged", "serve", file, *speed))
            self._start("agentd", "agentd", ("agentd", "serve", file, *speed))
        else:
            for board in self._network.addresses:
                self._start(f"commd-{board}", "commd", ("commd", "serve", file, "--board", board), board)
            self._start("bridged", "bridged", ("bridged", "serve", file, "--board", "pi2", *speed), "pi2")
            self._start("agentd", "agentd", ("agentd", "serve", file, "--board", "pi1", *speed), "pi1")
        self.until(lambda: self.said("on its way") is not None, "the copter is on its way", UP)
        time.sleep(2.0 / self.speed)

    def _start(self, name: str, unit: str, arguments: tuple[str, ...], board: str = "") -> None:
        managed = Managed(
            UnitFile.read(unit),
            (*arguments, "--state", str(self.folder / "state" / board / unit)),
            self.folder,
            within=self._network.within(board) if self._network and board else (),
            environment=self._environment,
            restart=self._restart,
            watchdog=self._watchdog,
        )
        self.daemons[name] = managed
        self._stack.callback(managed.close)

    @property
    def thinker(self) -> Managed:
        """The process in which the agent reasons."""
        return self.daemons.get("agentd") or self.daemons["board"]

    def hang(self) -> float:
        """Let a Python function of the program hang; returns since when it does."""
        after = time.monotonic()
        (self.folder / "hang").touch()
        self.until(lambda: self.thinker.said("hangs", after) is not None, "the function hangs", 10)
        return self.thinker.said("hangs", after) or after

    def said(self, words: str, after: float = 0.0) -> float | None:
        """Return when the agent, or what it runs in, said something."""
        return self.thinker.said(words, after)

    def transcript(self) -> str:
        """All that was said."""
        texts = [f"--- {name}\n{managed.text}" for name, managed in self.daemons.items()]
        return "\n".join([*texts, f"--- vehicle\n{self.vehicle.text}"])


def flown(fault: str, injected: str, **options: Any) -> Callable[[Callable[[Row, Scene], None]], Maker]:
    """Make a row of what is done to a copter in flight; options are those of a `Scene`."""
    return row_of(fault, injected, lambda folder: Scene(folder, **options))
