"""The daemons of a mission in tests: real processes, and what their agents print."""

import signal
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from tests.support.processes import Daemon, running

PING = """\
!start.
+!start : peer(Other) <- .print("hello"); .send(Other, tell, ping(1)).
+ping(N)[source(A)] : N < 5 <- .send(A, tell, ping(N+1)).
+ping(N) <- .print("enough: ", N); +enough.
"""
WAIT = """\
+ping(N)[source(A)] <- .send(A, tell, ping(N+1)).
"""
TWO = """\
mission: two
agents:
  a: {program: ping.asl, beliefs: ["peer(b)"]}
  b: {program: wait.asl}
done: "a: enough"
"""


def mission(folder: Path, text: str = TWO, **programs: str) -> str:
    """Write a mission and its programs; return the mission's path."""
    for name, program in {"ping": PING, "wait": WAIT, **programs}.items():
        (folder / f"{name}.asl").write_text(program)
    path = folder / "m.yaml"
    path.write_text(text)
    return str(path)


@contextmanager
def daemons(path: str, endpoint: str, *agents: str | Sequence[str]) -> Iterator[list[Daemon]]:
    """Start commd and one agentd for each of `agents`: an agent, arguments, or "" for all agents of the mission."""
    with ExitStack() as stack:
        stack.enter_context(running("commd", "serve", path, "--router", endpoint))
        arguments = [one.split() if isinstance(one, str) else one for one in agents]
        serves = [running("agentd", "serve", path, *one, "--router", endpoint) for one in arguments]
        yield [stack.enter_context(one) for one in serves]


def end(*daemons: Daemon) -> None:
    """Let daemons leave in order; nothing in them was a defect."""
    for daemon in daemons:
        daemon.signal(signal.SIGTERM)
    for daemon in daemons:
        code = daemon.ends()
        assert code == 0, (code, daemon.text)
        assert "defect" not in daemon.text


def printed(daemon: Daemon) -> list[str]:
    """The lines that its agents printed."""
    return [line for line in daemon.lines if line.startswith("[")]
