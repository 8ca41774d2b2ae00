"""What a process says when its watchdog ends it: where it hangs."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.processes import ROOT

_PROCESS = """\
import asyncio, os, signal, sys, time
from commd.process import run_daemon
sys.path.insert(0, os.path.dirname(sys.argv[1]))

async def main(stop):
    if sys.argv[2] == "hangs":
        import slow
        slow.forever()
    asyncio.get_running_loop().call_later(0.2, lambda: print("runs", flush=True))
    await stop.wait()
    return 0

run_daemon("agentd", main)
"""

_SLOW = """\
def forever():
    print("runs", flush=True)
    while True:
        pass
"""


@pytest.mark.parametrize(
    ("how", "said"),
    [
        (
            "hangs",
            "error: agentd: ended by SIGABRT, as by a watchdog, in forever (FOLDER/slow.py:",
        ),
        ("waits", "error: agentd: ended by SIGABRT, as by a watchdog, in "),
    ],
)
def test_an_aborted_daemon_names_the_function_that_does_not_return(how: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "slow.py").write_text(_SLOW)
    command = [sys.executable, "-c", _PROCESS, str(tmp_path / "slow.py"), how]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "runs\n"
        process.send_signal(signal.SIGABRT)
        _, told = process.communicate(timeout=30)
    assert process.returncode == -signal.SIGABRT
    assert said.replace("FOLDER", str(tmp_path)) in told
    assert "Traceback" not in told
