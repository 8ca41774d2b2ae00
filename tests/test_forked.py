"""Processes of tests do not outlive the tests."""

import os
import signal
import subprocess
import sys
from pathlib import Path

from tests.support.forked import ROOT
from tests.support.processes import poll

TESTS = """\
import sys
from tests.support.forked import Forked
one = Forked(["argosy", "simulate", sys.argv[1]], stdout=1, stderr=2)
print("started", one.pid, flush=True)
sys.stdin.read()
"""
MISSION = "missions/single_uav.yaml"


def _status(pid: int) -> dict[str, str]:
    """Return the fields of a process; empty if it has ended."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except (FileNotFoundError, ProcessLookupError):
        return {}
    found = dict(line.split(":\t", 1) for line in lines if ":\t" in line)
    return {} if found["State"].startswith("Z") else found


def test_a_test_run_that_is_killed_leaves_no_forked_process_and_not_their_parent() -> None:
    command = [sys.executable, "-c", TESTS, MISSION]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT) as tests:
        assert tests.stdout is not None
        child = next(int(line.split()[1]) for line in tests.stdout if line.startswith("started"))
        parent = int(_status(child)["PPid"])
        assert parent != tests.pid
        tests.kill()
    try:
        poll(lambda: not any(map(_status, (child, parent))), "both end with their tests")
    finally:
        for pid in (child, parent):
            if _status(pid):
                os.kill(pid, signal.SIGKILL)
