"""Lines to a reader that may stop reading: the daemon goes on."""

import array
import fcntl
import os
import pty
import re
import signal
import subprocess
import sys
import termios
import time
from pathlib import Path
from typing import IO

import pytest

from commd.process.output import Output
from tests.support.processes import ROOT, running
from tests.support.promises import in_time

MISSION = """\
mission: talk
agents:
  a: {program: a.asl}
"""
CHATTER = """\
!talk.
+!talk <- .print("0123456789012345678901234567890123456789012345678901234567890123456789"); !talk.
"""
SPEAKER = """\
import logging
from commd.process.process import run_daemon

async def main(stop):
    logging.info("here")
    return 0

raise SystemExit(run_daemon("test", main))
"""


def test_lines_arrive_in_order_and_whole() -> None:
    reader, writer = os.pipe()
    output = Output(writer)
    for number in range(1000):
        output.write(f"line {number} ä\ud800")
    output.flush(10)
    os.close(writer)
    with os.fdopen(reader, encoding="utf-8") as lines:
        assert lines.read().splitlines() == [f"line {number} ä\\ud800" for number in range(1000)]


def test_who_does_not_read_stops_nobody_and_the_dropped_lines_are_counted_and_told() -> None:
    reader, writer = os.pipe()
    output = Output(writer, lines=100)
    started = time.monotonic()
    for _ in range(2000):
        output.write("x" * 1000)
    assert in_time(time.monotonic() - started, 5)
    assert output.dropped > 1500
    with os.fdopen(reader, "rb", buffering=0) as lines:
        said = b""
        while b"lines were dropped: they were not read" not in said:
            said += lines.read(65536)
            output.write("later")
    os.close(writer)


def test_a_closed_reader_is_no_reason_to_stop() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    output = Output(writer)
    output.write("nobody is there")
    output.flush(10)
    assert output.dropped == 1
    os.close(writer)


@pytest.mark.parametrize(("reader", "dated"), [("terminal", True), ("file", True), ("pipe", False)])
def test_a_log_line_tells_the_time_where_nobody_else_notes_it(tmp_path: Path, reader: str, dated: bool) -> None:
    def file() -> tuple[int, int]:
        (tmp_path / "log").touch()
        return os.open(tmp_path / "log", os.O_RDONLY), os.open(tmp_path / "log", os.O_WRONLY)

    far, near = {"terminal": pty.openpty, "pipe": os.pipe, "file": file}[reader]()
    subprocess.run([sys.executable, "-c", SPEAKER], stderr=near, cwd=ROOT, timeout=60, check=True)
    said = os.read(far, 1000).decode().strip()
    os.close(far)
    os.close(near)
    when = r"\d\d:\d\d:\d\d\.\d\d\d " if dated else ""
    assert re.fullmatch(f"{when}INFO test root here", said), said


def fill(pipe: IO[bytes] | None) -> None:
    """Wait until nothing more goes into a pipe that nobody reads."""
    assert pipe is not None
    end, before, waiting = time.monotonic() + 30, -1, array.array("i", [0])
    while waiting[0] == 0 or waiting[0] != before:
        assert time.monotonic() < end, f"{waiting[0]} bytes after 30 s, and they still grow"
        before = waiting[0]
        time.sleep(0.5)
        fcntl.ioctl(pipe, termios.FIONREAD, waiting)


def test_a_daemon_whose_output_nobody_reads_still_leaves_when_told_to(tmp_path: Path, endpoint: str) -> None:
    (tmp_path / "m.yaml").write_text(MISSION)
    (tmp_path / "a.asl").write_text(CHATTER)
    with running("commd", "serve", str(tmp_path / "m.yaml"), "--router", endpoint) as commd:
        commd.says("router board=local")
        agent = subprocess.Popen(
            [sys.executable, "-m", "agentd", "serve", str(tmp_path / "m.yaml"), "--router", endpoint],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            cwd=ROOT,
        )
        try:
            fill(agent.stdout)
            agent.send_signal(signal.SIGTERM)
            assert agent.wait(90) == 0
        finally:
            agent.kill()
            agent.wait(10)
