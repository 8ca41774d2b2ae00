"""How long a reasoner takes to start and to load, and how much memory it holds."""

from __future__ import annotations

import statistics
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.processes import until_line
from benchmarks.reasoner.rows import ELSEWHERE, PROGRAMS
from benchmarks.reasoner.subjects import Subject

SETTLE: Final = 0.5
"""Seconds between the word that an agent is idle and the look at its memory."""


@dataclass(frozen=True)
class Footprint:
    """A figure about one process. ``limit`` is what is asked of agentd; ``jason`` what Jason was measured at."""

    title: str
    unit: str
    limit: float
    jason: float | None
    measure: Callable[[Subject, int], float]
    why: str
    """Told when the limit is not kept: the reason, as far as it is known, and what was tried."""


def _median_of(times: int, measure: Callable[[], tuple[float, float]], which: int) -> float:
    return statistics.median(measure()[which] for _ in range(times))


def _first(program: str, which: int, most: int = 3, settle: float = 0.0) -> Callable[[Subject, int], float]:
    """Return what measures seconds until a program's first print (0) or MB then (1), at most so many times."""

    def measure(subject: Subject, times: int) -> float:
        with subject.prepared([("ag", PROGRAMS / program)]) as command:
            return _median_of(min(times, most), lambda: until_line(command, "FIRST", settle), which)

    return measure


def program_of_plans(count: int) -> str:
    """A program with so many plans, each with a context and a body of three formulas."""
    plans = [
        f"+!goal_{n}(X, Y) : limit_{n % 50}(L) & X < L & not blocked({n}) <-\n"
        f'    +visited({n}, X);\n    .print("goal {n} at ", X, " of ", Y);\n    !goal_{(n + 1) % count}(X + 1, Y).\n'
        for n in range(count)
    ]
    facts = [f"limit_{n}({n + 10}).\n" for n in range(50)]
    return "".join([*facts, "!start.\n", '+!start <- .print("FIRST"); .stopMAS.\n', *plans])


def _plans(subject: Subject, times: int) -> float:
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder, "plans.asl")
        program.write_text(program_of_plans(1000), encoding="utf-8")
        with subject.prepared([("ag", program)]) as command:
            return _median_of(min(times, 5), lambda: until_line(command, "FIRST"), 0)


_START: Final = (
    "Python itself and the imports take most of it; tried: no import but those that tests/test_imports.py names, byte "
    "code that is compiled before."
)
_HELD: Final = "What of it is held by whom is not known; tried: no import but those that tests/test_imports.py names."
FOOTPRINTS: Final = (
    Footprint("start to first print", "s", 0.25, ELSEWHERE.start, _first("s_first.asl", 0, 10), _START),
    Footprint("resident when idle", "MB", 30, ELSEWHERE.idle, _first("i_idle.asl", 1, settle=SETTLE), _HELD),
    Footprint("resident with 10,000 beliefs", "MB", 40, None, _first("m_beliefs.asl", 1, settle=SETTLE), _HELD),
    Footprint("start of a program of 1,000 plans", "s", 1.5, None, _plans, _START),
)
"""What is measured besides speed, in the order of the report."""
