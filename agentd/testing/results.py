"""Results: of an assertion, of a test plan, of a file that cannot be read."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Asserted:
    """An assertion was made; an effect of the mind that runs the test. ``message`` is empty when it held."""

    message: str
    formula: str
    """The assertion with the values of its variables."""
    file: str
    line: int
    """The place of the assertion in the program; 0 if it is not known."""
    goals: tuple[str, ...] = ()
    """The goals that led to it, innermost first."""


@dataclass(frozen=True, slots=True)
class TestEnded:
    """The goal of the test was achieved, or (with ``error``) has failed; an effect of the mind that runs it."""

    __test__ = False  # no test of pytest's

    error: str = ""
    message: str = ""
    formula: str = ""
    file: str = ""
    line: int = 0


class Verdict(enum.Enum):
    """The result of a test plan."""

    PASSED = "ok"
    FAILED = "FAIL"
    ERROR = "ERROR"
    TIMED_OUT = "TIMEOUT"


@dataclass(slots=True)
class Outcome:
    """The outcome of one test plan."""

    name: str
    file: str
    line: int
    verdict: Verdict = Verdict.PASSED
    assertions: int = 0
    own_assertions: bool = False
    """Whether the program brings its own plans for assertions, so that they cannot be counted."""
    message: str = ""
    """Why it did not pass, in one line."""
    formula: str = ""
    place: str = ""
    """``file:line`` of the formula that failed."""
    excerpt: str = ""
    """The line of source there."""
    goals: tuple[str, ...] = ()
    seconds: float = 0.0
    """Real seconds that it took."""
    unapplied: list[str] = field(default_factory=list)
    """The events for which no plan applied, and why each plan did not; of a test that did not pass."""
    output: list[str] = field(default_factory=list)
    """The prints and logs of its agents."""

    @property
    def passed(self) -> bool:
        """Whether the test passed."""
        return self.verdict is Verdict.PASSED

    @property
    def empty(self) -> bool:
        """Whether it passed without showing anything."""
        return self.passed and not self.assertions and not self.own_assertions


@dataclass(slots=True)
class Unread:
    """A file that holds tests, or was named as one, and cannot be used."""

    file: str
    message: str
