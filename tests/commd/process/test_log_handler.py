"""What a daemon logs: lines for the journal and for people, and no flood."""

import logging
import os
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

from commd.process.log_handler import BURST, KINDS, WINDOW, LineFormatter, LogHandler, one_line
from commd.process.output import Output
from schemas.wire import log_lines
from schemas.wire.log_lines import LONGEST, AnyEvent, LogLine, RobotReleased
from tests.support.processes import ROOT

SPEAKER = """\
import logging
from commd.process.output import stdout
from commd.process.process import run_daemon
from schemas.files.findings import Finding, Findings
from schemas.wire.log_lines import RobotReleased

async def main(stop):
    log = logging.getLogger("mail")
    log.info("taken=%d", 3)
    log.warning("two\\nlines <0>")
    try:
        {}["x"]
    except KeyError:
        log.exception("defect in argosy: %s", "a save")
    log.info("an event", extra={"event": RobotReleased(robot="uav1")})
    stdout().write("<0>of a program", agent="a")
    raise Findings([Finding("m.yaml", 1, 2, "one"), Finding("m.yaml", 3, 4, "two")])

raise SystemExit(run_daemon("commd", main))
"""


class Recorded(Output):
    """An output that keeps its lines."""

    def __init__(self) -> None:
        self.lines: list[tuple[int, str]] = []

    def write(self, text: str, priority: int = 6, *, agent: str = "", event: AnyEvent | None = None) -> None:
        self.lines.append((priority, text))


class Desk:
    """A logger of a daemon whose clock the test moves."""

    def __init__(self) -> None:
        self.output, self.time = Recorded(), 1000.0
        self.handler = LogHandler(self.output, lambda: self.time)
        self.handler.setFormatter(LineFormatter("%(levelname)s commd %(name)s "))
        self.log = logging.Logger("mail")
        self.log.addHandler(self.handler)

    @property
    def said(self) -> list[str]:
        return [line for _, line in self.output.lines]


@pytest.fixture
def desk() -> Desk:
    return Desk()


def spoken(
    tmp_path: Path, *, journal: bool = False, wanted: Mapping[str, str] | None = None
) -> tuple[list[str], list[str], int]:
    """What a daemon says to a stream that is, or is not, the journal's: standard error and output, and how it ends."""
    reader, writer = os.pipe()
    found = os.fstat(writer)
    environment = {**os.environ, **(wanted or {})}
    environment.pop("JOURNAL_STREAM", None)
    environment.pop("ARGOSY_DEBUG", None)
    if journal:
        environment["JOURNAL_STREAM"] = f"{found.st_dev}:{found.st_ino}"
    with (tmp_path / "out").open("wb+") as out:
        ended = subprocess.run(
            [sys.executable, "-c", SPEAKER],
            stderr=writer,
            stdout=writer if journal else out,
            env=environment,
            timeout=60,
            cwd=ROOT,
        )
        os.close(writer)
        with os.fdopen(reader) as lines:
            said = lines.read().splitlines()
        out.seek(0)
        return said, out.read().decode().splitlines(), ended.returncode


def test_to_the_journal_each_line_begins_with_its_priority_also_what_a_program_prints(tmp_path: Path) -> None:
    said, _, code = spoken(tmp_path, journal=True)
    assert code == 2
    printed = "<6>[a] <0>of a program"  # by another thread than what is logged: its place among the others is open
    assert said.count(printed) == 1
    assert [line for line in said if line != printed] == [
        "<6>INFO commd mail taken=3",
        r"<4>WARNING commd mail two\nlines <0>",
        "<3>ERROR commd mail defect in argosy: a save error=KeyError: 'x' at=<string>:12",
        "<6>INFO commd mail an event",
        "<3>m.yaml:1:2: error: one",
        "<3>m.yaml:3:4: error: two",
    ]


def test_to_anybody_else_lines_have_no_priority(tmp_path: Path) -> None:
    said, printed, code = spoken(tmp_path)
    assert code == 2
    assert said[0] == "INFO commd mail taken=3"
    assert not any(line.startswith("<") for line in said)
    assert printed == ["[a] <0>of a program"]


def test_to_a_supervisor_that_wants_it_each_line_is_a_record_with_what_it_acts_on(tmp_path: Path) -> None:
    said, printed, code = spoken(tmp_path, wanted=log_lines.AS_JSON)
    assert code == 2
    assert [log_lines.decode(line.encode()) for line in said] == [
        LogLine(text="taken=3", level="info"),
        LogLine(text=r"two\nlines <0>", level="warning"),
        LogLine(text="defect in argosy: a save error=KeyError: 'x' at=<string>:12", level="error"),
        LogLine(text="an event", level="info", event=RobotReleased(robot="uav1")),
        LogLine(text="m.yaml:1:2: error: one", level="error"),
        LogLine(text="m.yaml:3:4: error: two", level="error"),
    ]
    assert [log_lines.decode(line.encode()) for line in printed] == [
        LogLine(text="<0>of a program", level="info", agent="a")
    ]


def test_a_text_without_end_is_cut_in_a_record() -> None:
    reader, writer = os.pipe()
    output = Output(writer, structured=True)
    output.write("é" * 100_000)
    output.flush(10)
    os.close(writer)
    with os.fdopen(reader, "rb") as lines:
        line = log_lines.decode(lines.read())
    assert line == LogLine(text="é" * LONGEST + f"… ({100_000 - LONGEST} characters more)", level="info")


def test_no_other_text_is_taken_for_a_record() -> None:
    for text in (b"", b"error: no", b"[a] hello", b'{"text": 1}', b'"text"', b"\xff", b'{"text": "", "level": "loud"}'):
        assert log_lines.decode(text) is None


def test_of_one_kind_so_many_pass_and_the_rest_is_counted_and_told(desk: Desk) -> None:
    for number in range(BURST + 1000):
        desk.log.warning("bad_input key=%s", number)
    assert len(desk.said) == BURST
    assert desk.said[-1] == f"WARNING commd mail bad_input key={BURST - 1}"
    desk.handler.end_window()
    assert desk.output.lines[-1] == (4, f"WARNING commd mail suppressed=1000 the last: bad_input key={BURST + 999}")
    desk.handler.end_window()
    assert len(desk.said) == BURST + 1, "it is told once"


def test_a_flood_of_one_kind_keeps_no_other_and_no_other_subject_from_being_told(desk: Desk) -> None:
    for _ in range(BURST + 10):
        desk.log.warning("agent=%s it fails", "a")
    desk.log.warning("agent=%s it fails", "b")
    desk.log.error("agent=%s it fails", "a")
    desk.log.warning("disk full")
    assert desk.said[BURST:] == [
        "WARNING commd mail agent=b it fails",
        "ERROR commd mail agent=a it fails",
        "WARNING commd mail disk full",
    ]
    desk.handler.end_window()


def test_no_event_is_suppressed(desk: Desk) -> None:
    for number in range(BURST + 10):
        desk.log.info("leaving %s", number, extra={"event": RobotReleased(robot=f"uav{number}")})
    assert len(desk.said) == BURST + 10


def test_in_each_window_as_many_lines_pass_and_its_count_precedes_the_next(desk: Desk) -> None:
    def pour(count: int) -> int:
        before = len(desk.said)
        for _ in range(count):
            desk.log.info("x")
        return len(desk.said) - before

    assert pour(1000) == BURST
    desk.time += WINDOW - 0.1
    assert pour(1000) == 0
    desk.time += 0.1
    assert pour(1000) == 1 + BURST
    assert desk.said[BURST] == f"INFO commd mail suppressed={2000 - BURST} the last: x"
    desk.handler.end_window()


def test_kinds_without_end_are_one_kind_and_those_of_the_window_before_are_forgotten(desk: Desk) -> None:
    def pour(word: str) -> int:
        before = len(desk.said)
        for number in range(2 * KINDS):
            desk.log.info(f"{word} {number}")
        return len(desk.said) - before

    assert pour("one") == KINDS + BURST
    assert pour("two") == 0
    desk.time += WINDOW
    assert pour("three") == 1 + KINDS + BURST, "the count of the window before, and lines"
    desk.handler.end_window()


def test_the_last_error_is_that_of_the_agent_or_of_nobody_in_particular(desk: Desk) -> None:
    assert desk.handler.last_error("a") is None
    desk.log.error("agent=%s nothing is kept", "a")
    desk.time += 5
    desk.log.error("agent=%s is lost", "b")
    desk.log.warning("agent=%s is slow", "a")
    found = desk.handler.last_error("a")
    assert (found.text, found.at) == ("agent=a nothing is kept", 1000.0)
    desk.time += 5
    desk.log.error("disk full")
    assert [one.text for name in ("a", "b") if (one := desk.handler.last_error(name))] == ["disk full", "disk full"]
    assert desk.handler.errors == 3


def test_an_error_that_does_not_pass_is_still_the_last_one(desk: Desk) -> None:
    for number in range(BURST + 7):
        desk.log.error("try %d", number)
    found = desk.handler.last_error("")
    assert found.text == f"try {BURST + 6}"
    assert desk.handler.errors == BURST + 7
    desk.handler.end_window()


@pytest.mark.parametrize(
    ("message", "args", "line"),
    [
        ({"battery": 3}, (), "{'battery': 3}"),
        (["a"], (), "['a']"),
        (ValueError("no fix"), (), "no fix"),
        ("battery %d", ("full",), "a line that cannot be formatted (TypeError): 'battery %d'"),
        ("one %s", ("1", "2"), "a line that cannot be formatted (TypeError): 'one %s'"),
    ],
)
def test_whoever_logs_what_is_no_line_is_not_stopped_by_it_and_floods_nobody(
    desk: Desk, message: object, args: tuple[str, ...], line: str
) -> None:
    for _ in range(BURST + 10):
        desk.log.error(message, *args)
    assert desk.said == [f"ERROR commd mail {line}"] * BURST
    assert desk.handler.errors == BURST + 10
    desk.handler.end_window()


def test_exceptions_are_no_kinds_of_their_own(desk: Desk) -> None:
    for number in range(BURST + 10):
        desk.log.warning(ValueError(f"{number}"))
    assert len(desk.said) == BURST
    desk.handler.end_window()


def test_a_line_is_unicode_whatever_a_file_is_called() -> None:
    assert one_line("no such file: \udcff.jpg\n") == r"no such file: \udcff.jpg"


def test_a_line_has_no_controls_and_an_end() -> None:
    assert one_line("a\tb\x1b[31mc\u2028d\n") == r"a\tb\x1b[31mc\u2028d"
    long = one_line("x" * (LONGEST + 10))
    assert re.fullmatch("x+… \\(10 characters more\\)", long)
