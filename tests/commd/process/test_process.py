"""A daemon as a process: how it ends."""

from __future__ import annotations

import subprocess
import sys

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
    ended = subprocess.run([sys.executable, "-c", LINGERING], capture_output=True, text=True, timeout=30, cwd=ROOT)
    assert ended.returncode == 3
    assert "ending although threads still run: reader" in ended.stderr
