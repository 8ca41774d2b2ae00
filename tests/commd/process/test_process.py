"""A daemon as a process: how it ends."""

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.support.processes import ROOT

LINGERING = """\
import threading, time
from commd.process.process import run_daemon

async def main(stop):
    threading.Thread(target=time.sleep, args=(60,), name="reader").start()
    return 3

raise SystemExit(run_daemon("test", main))
"""


def test_a_thread_that_an_extension_has_left_does_not_keep_the_process_and_is_named() -> None:
    ended = subprocess.run([sys.executable, "-c", LINGERING], capture_output=True, text=True, timeout=90, cwd=ROOT)
    assert ended.returncode == 3
    assert "ending although threads still run: reader" in ended.stderr


FULL = """\
import errno, os
from commd.process.process import run_daemon

async def main(stop):
    raise OSError(NUMBER, os.strerror(NUMBER), "/state")

raise SystemExit(run_daemon("test", main))
"""


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.ENFILE])
def test_a_full_disk_or_file_table_is_an_error_that_a_later_start_may_not_have_and_no_defect(number: int) -> None:
    script = FULL.replace("NUMBER", str(number))
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=90, cwd=ROOT)
    assert ended.returncode == 1
    said = f"error: test: the system refuses: [Errno {number}] {os.strerror(number)}: '/state'"
    assert ended.stderr.strip().endswith(said)


_PROCESS = """\
import asyncio, os, signal, sys, time
from commd.process.process import run_daemon
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
    ("how", "python", "said"),
    [
        ("hangs", "", "in forever (FOLDER/slow.py:"),
        ("waits", "", "in select ("),
        ("waits", "behind a link", "in select (FOLDER/python/lib/"),
    ],
)
def test_an_aborted_daemon_names_the_function_that_hangs(how: str, python: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "slow.py").write_text(_SLOW)
    command = [sys.executable, "-c", _PROCESS, str(tmp_path / "slow.py"), how]
    variables = dict(os.environ)
    if python:
        (tmp_path / "python").symlink_to(sys.base_prefix)
        variables["PYTHONHOME"] = str(tmp_path / "python")
    with subprocess.Popen(
        command, cwd=ROOT, env=variables, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "runs\n"
        for _ in range(2000):
            if how == "hangs" or _state(process.pid) == "S":
                break
            time.sleep(0.01)
        process.send_signal(signal.SIGABRT)
        _, told = process.communicate(timeout=90)
    assert process.returncode == -signal.SIGABRT
    assert f"error: agentd: ended by SIGABRT, as by a watchdog, {said}".replace("FOLDER", str(tmp_path)) in told
    assert ("which has not returned" in told) == (how == "hangs")
    assert "Traceback" not in told


def _state(pid: int) -> str:
    """The state of a process as the kernel has it: S = it waits."""
    return Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2][0]
