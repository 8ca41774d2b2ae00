"""Asking why: programs that real daemons run, and what `argosy why` says of them, with its times made the same."""

import contextlib
import io
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from argosy.__main__ import main
from tests.support.processes import Daemon, running

MISSION = """\
mission: why
agents:
  uav: {program: uav.asl}
done: "uav: never"
"""


def why(endpoint: str, *arguments: str) -> tuple[int, str, str]:
    """Run `argosy why`. Returns its exit code, what it said and what it complained about."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(["why", *arguments, "--router", endpoint])
    return code, out.getvalue(), err.getvalue()


def told(endpoint: str, *arguments: str) -> str:
    """What `argosy why` says, with all times and cycles as the letters that the documentation shows them by."""
    code, text, error = why(endpoint, *arguments)
    assert (code, error) == (0, "")
    return timeless(text)


def timeless(text: str) -> str:
    """The text with `S s ago (mission second T)` for each time."""
    text = re.sub(r"\bnow \(mission second", "S s ago (mission second", text)
    text = re.sub(r"[0-9.]+ s ago", "S s ago", text)
    text = re.sub(r"[0-9.]+ s more", "S s more", text)
    text = re.sub(r"waited for [0-9.]+ s", "waited for S s", text)
    text = re.sub(r"and [0-9.]+ s later", "and S s later", text)
    text = re.sub(r"mission second [0-9.]+", "mission second T", text)
    return re.sub(r"cycle [0-9]+", "cycle C", text)


def eventually(ask: Callable[[], str], fits: Callable[[str], bool], seconds: float = 90) -> str:
    """Ask until the text fits; returns it, or the last one after a bound. An agent may be too busy to answer."""
    end = time.monotonic() + seconds
    while True:
        late = time.monotonic() > end
        try:
            text = ask()
        except AssertionError:
            if late:
                raise
            continue
        if late or fits(text):
            return text
        time.sleep(0.1)


@contextmanager
def agent(
    folder: Path, endpoint: str, program: str, *arguments: str, mission: str = MISSION, board: tuple[str, ...] = ()
) -> Iterator[Daemon]:
    """A board and the agent `uav` with a program, as daemons; the program is `uav.asl`."""
    (folder / "uav.asl").write_text(program)
    path = folder / "why.yaml"
    path.write_text(mission)
    state = ("--state", str(folder / "state"))
    with (
        running("commd", "serve", str(path), *board, *state, "--router", endpoint) as router,
        running("agentd", "serve", str(path), *arguments, *state, "--router", endpoint) as daemon,
    ):
        router.says("router board=")
        daemon.says("agentd agents=")
        yield daemon
