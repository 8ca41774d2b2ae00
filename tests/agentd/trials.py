"""One input tried: the parser reads it or says what is wrong with it, in time, and what it reads can be run."""

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

from agentd.check.command import Robot, findings_of
from agentd.check.external_knowledge import from_team
from agentd.check.programs import read_survey
from agentd.language.compiler.compile import DirectiveError, compile_program
from agentd.language.parse import parse_program
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.language.syntax_tree.nodes import Program, fields_of
from agentd.language.syntax_tree.printer import source_text
from agentd.mind import Mind
from agentd.mind.data.effects import PerformAction, TeamRequest
from agentd.mind.data.inputs import ActionDone, TeamReply
from agentd.process import allow_deep_calls
from agentd.runtime.program_paths import SourcePaths
from tests.agentd.check.findings import findings_about
from tests.agentd.generated_programs import corpus

HANG: Final = 20.0
"""Seconds of processor time after which an input counts as one that never ends."""
PATIENCE: Final = 200.0
"""An input may take so many times as long as good programs of its length do, and of `_SHORT` characters at least."""
_SHORT: Final = 1000
LONGEST_MESSAGE: Final = 400
CYCLES: Final = 200
TIRED: Final = 2.0
"""Seconds of processor time after which a program that runs is left alone: it may compute as long as it likes."""


class TooLong(BaseException):
    """The processor time is over; no handler of what was tried may take it for its own."""


def parsed(text: str) -> Program | None:
    """The program of a text, None if it is refused; fails when the parser does anything else, or tells nothing."""
    try:
        with at_most(HANG):
            program = parse_program(text, "a.asl")
    except SyntaxErrors as errors:
        lines = text.count("\n") + 1
        assert errors.findings, "refused without a word"
        for finding in errors.findings:
            assert finding.file == "a.asl", "a finding of another file"
            assert 1 <= finding.line <= lines, f"line {finding.line} of {lines}"
            assert finding.column >= 1, "no column"
            assert finding.message.strip(), "no message"
            assert "\n" not in finding.message, "a message of several lines"
            assert len(finding.message) < LONGEST_MESSAGE, "a message that nobody reads to its end"
        return None
    return program


def try_to_read(text: str) -> Program | None:
    """`parsed`, and what is read prints as itself and can be checked."""
    program = parsed(text)
    if program is not None:
        with at_most(HANG):
            assert same(parse_program(source_text(program), "a.asl"), program), "printed, it reads differently"
            findings_about(program, {}, {})
            surveyed = read_survey(program, SourcePaths())
            findings_of(surveyed, Robot(), from_team([surveyed.survey]))
    return program


def same(one: Any, other: Any) -> bool:
    """Whether two trees are equal, of any depth: the comparison of nodes goes only as deep as Python's stack."""
    pending = [(one, other)]
    while pending:
        left, right = pending.pop()
        if type(left) is not type(right):
            return False
        if isinstance(left, tuple):
            if len(left) != len(right):
                return False
            pending += zip(left, right, strict=True)
        elif names := fields_of(type(left)):
            compared = (name for name in names if name not in ("position", "warnings", "scoped", "this_ns"))
            pending += ((getattr(left, name), getattr(right, name)) for name in compared)
        elif left != right:
            return False
    return True


class Pace:
    """How long good programs take to read on this machine, now: the measure of how long others may take."""

    def __init__(self) -> None:
        self._text = ""
        for text in corpus():
            if parsed(text) is not None:
                self._text += text + "\n"
        self._measure()

    def _measure(self) -> None:
        self.per_character = min(_seconds(self._text) for _ in range(3)) / len(self._text)

    def too_slow(self, text: str) -> str:
        """What is to be said of a text that takes too long to read, else nothing; measured anew before it is said."""
        seconds = _seconds(text)
        for _ in range(3):
            bound = PATIENCE * self.per_character * max(len(text), _SHORT)
            if seconds <= bound:
                return ""
            self._measure()
            seconds = min(seconds, _seconds(text))
        return f"took {seconds:.3f} s; {len(text)} characters of good programs take {bound / PATIENCE:.4f} s"


def _seconds(text: str) -> float:
    started = time.perf_counter()
    parsed(text)
    return time.perf_counter() - started


def try_to_run(program: Program, seed: int = 0) -> str:
    """Run a program that was read for a while, without a world: how that ended. Nothing may escape from the mind."""
    allow_deep_calls()
    try:
        with at_most(TIRED):
            compiled = compile_program(program, _nothing_to_include)
            mind = Mind("bob", compiled, seed=seed, has_team=True)
            return _run(mind)
    except DirectiveError:
        return "refused"
    except TooLong:
        return "too long"


def _nothing_to_include(path: Any) -> Program:
    raise FileNotFoundError(2, "No such file or directory", str(path))


def _run(mind: Mind) -> str:
    now = 0.0
    for _ in range(CYCLES):
        for effect in mind.step(now):
            match effect:
                case PerformAction(id=number):
                    mind.feed(ActionDone(number, False, "nobody can do this"))
                case TeamRequest(id=number):
                    mind.feed(TeamReply(number, None, "action_failed", "there is no team"))
        if not mind.ready:
            if mind.wake_at is None:
                return "idle"
            now = max(now, mind.wake_at)
    return "running"


@contextmanager
def at_most(seconds: float) -> Iterator[None]:
    """Raise `TooLong` in this thread when the processor has worked for so long."""

    def end(*_: Any) -> None:
        raise TooLong(f"more than {seconds} s of processor time")

    before = signal.signal(signal.SIGVTALRM, end)
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds, 0.05)  # again and again: a callback may have swallowed the first
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)
