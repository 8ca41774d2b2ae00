"""A small mission that flies: a router, a bridge with a simulated copter and an agent that prints what it perceives."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from tests.support.ports import free_port
from tests.support.processes import Daemon, running

MISSION = """
mission: trial
agents: {{uav: {{program: uav.asl, robot: uav1}}, base: {{program: uav.asl}}}}
robots:
  uav1:
    manifest: copter
    link: udpin:127.0.0.1:{port}
    simulate: {{vehicle: copter, home: [-27.604033, -48.518363, 21.0]}}
router: {{endpoint: "{endpoint}"}}
speed: 5
inject: {inject}
wire: {wire}
"""
PROGRAM = """
+victim(X,Y,Z)[source(S)] <- .print("victim at ", X, " from ", S).
-victim(X,Y,Z) <- .print("no victim at ", X).
"""


class Trial:
    """The mission's daemons, each a process."""

    def __init__(self, folder: Path, stack: contextlib.ExitStack, inject: bool, wire: str) -> None:
        self.endpoint, self.path = f"tcp/127.0.0.1:{free_port()}", folder / "trial.yaml"
        port = free_port()
        folder.mkdir(exist_ok=True)
        text = MISSION.format(port=port, endpoint=self.endpoint, inject=str(inject).lower(), wire=wire)
        self.path.write_text(text)
        (folder / "uav.asl").write_text(PROGRAM)
        self._stack, self._state = stack, str(folder / "state")
        self.commd = self.serve("commd")
        self.commd.says("router board=")
        link = ("--link", f"udpout:127.0.0.1:{port}")
        patient = ("--param", "DISARM_DELAY=127")  # s; the usual 10 are 2 at this speed, less than two commands take
        self.copter = self.start("bridged", "simulate", "copter", *link, "--speed", "5", *patient)
        self.bridged = self.serve("bridged")
        self.agentd = self.serve("agentd")
        self.bridged.says("serving uav1")
        self.agentd.says("bridge_up robot=uav1")

    def start(self, *arguments: str) -> Daemon:
        return self._stack.enter_context(running(*arguments))

    def serve(self, daemon: str) -> Daemon:
        return self.start(daemon, "serve", str(self.path), "--state", self._state)


@contextlib.contextmanager
def trial(folder: Path, *, inject: bool = True, wire: str = "json") -> Iterator[Trial]:
    """Let the mission run while the block runs."""
    with contextlib.ExitStack() as stack:
        yield Trial(folder, stack, inject, wire)
