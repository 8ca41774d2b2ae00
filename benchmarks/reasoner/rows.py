"""The rows of the comparison, each with its programs, operation and goal; start, load and memory."""

from __future__ import annotations

import statistics
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from benchmarks.processes import until_line
from benchmarks.reasoner.subjects import Subject
from benchmarks.results import RESULTS

FILE: Final = RESULTS / "jason-elsewhere.json"


@dataclass(frozen=True)
class Jason:
    """What Jason did in a row, beside python-agentspeak in the same session."""

    warm: float
    """Operations per second, the mean of the last two rounds; the median of the runs."""
    cold: float | None
    """Operations per second in the first round; None where it was not recorded."""
    agentspeak: float
    """What python-agentspeak did there, warm. It does not warm up, so this is also its first round."""
    rss: float
    """Peak resident memory, MB."""

    @property
    def warm_ratio(self) -> float:
        """Warm speed over python-agentspeak's."""
        return self.warm / self.agentspeak

    @property
    def cold_ratio(self) -> float | None:
        """Speed of the first round over python-agentspeak's."""
        return None if self.cold is None else self.cold / self.agentspeak


@dataclass(frozen=True)
class Origin:
    """Where the figures come from, as far as it is known."""

    known: str
    """The day on which they came into this repository."""
    date: str
    """Of the measurement."""
    machine: str
    versions: dict[str, str]
    runs: int
    """Of which they are medians."""
    noise: str
    memory: str
    """The unit of memory."""

    def line(self) -> str:
        """Return it as a sentence for a page."""
        versions = ", ".join(f"{name} {number}" for name, number in self.versions.items())
        return (
            f"Measured elsewhere: {versions}, on {self.machine}; medians of {self.runs} runs, noise {self.noise}; date "
            f"{self.date}, here since {self.known} (`benchmarks/results/{FILE.name}`)."
        )


@dataclass(frozen=True)
class Elsewhere:
    """The file."""

    origin: Origin
    start: float
    """Seconds from the start to the first print."""
    idle: float
    """MB resident."""
    rows: dict[str, Jason]
    """By the key of the row."""


ELSEWHERE: Final = msgspec.json.decode(FILE.read_bytes(), type=Elsewhere)
"""What Jason was measured to do elsewhere. Its ratios to python-agentspeak can be held against a run on another,
roughly: what a compiler at run time gains over an interpreter differs from processor to processor."""

PROGRAMS: Final = Path(__file__).parent / "programs"


_MESSAGES: Final = (
    "The time is spent between the minds (turn, effect, message, event), where python-agentspeak has one call of a "
    "function; tried: shortened where a count of instructions showed more than was needed "
    "([mind.md](../architecture/mind.md#speed))."
)
_REASONING: Final = (
    "Why just this row is under what is asked is not known; tried: plans made into Python code, facts indexed by their "
    "arguments, an intention alone that runs in the cycle of its event, mypyc "
    "([mind.md](../architecture/mind.md#mypyc))."
)
_PERCEPTS: Final = (
    "Each percept is an input and each action an effect that can be recorded and replayed; python-agentspeak's action "
    "is a call of a function; tried: shortened by a count of what a cycle costs, in the interpreter and, by callgrind, "
    "below it; percepts kept by signature and then by arguments cost more, not less "
    "([mind.md](../architecture/mind.md#speed))."
)


@dataclass(frozen=True)
class Row:
    """One line of the table. ``bench`` is the name that the program prints; two rows may share a program."""

    key: str
    bench: str
    operation: str
    agents: tuple[tuple[str, str], ...]
    """Name of each agent, and its program: a path, or a file in `PROGRAMS`."""
    target: float
    """How many times python-agentspeak's warm speed is asked for."""
    environment: str = ""
    """For the percept rows: ``module:Class`` of the environment, or the module that embeds agentd's mind itself."""
    why: str = _REASONING
    """The reason for a missed target, as far as it is known, and what was tried."""

    @property
    def jason(self) -> Jason | None:
        """What Jason did, where that is known."""
        return ELSEWHERE.rows.get(self.key)

    def paths(self) -> list[tuple[str, Path]]:
        return [(name, PROGRAMS / file) for name, file in self.agents]


def _alone(program: str) -> tuple[tuple[str, str], ...]:
    return (("ag", program),)


ROWS: Final = (
    Row("a", "a_goal_loop", "sub-goal", _alone("a_goal_loop.asl"), 12),
    Row("b", "b_belief_churn", "belief change", _alone("b_belief_churn.asl"), 12),
    Row("c0", "c0_fill_10k", "fact added", _alone("c_query_bound.asl"), 4),
    Row("c", "c_query_bound", "look-up in 10,000", _alone("c_query_bound.asl"), 500),
    Row("c2", "c2_join", "pair of 500 x 500", _alone("c2_join.asl"), 20),
    Row("d", "d_fib", "rule call", _alone("d_fib.asl"), 12),
    Row("d2", "d2_path", "solution", _alone("d2_path.asl"), 6),
    Row("e", "e_intentions", "step of 1,000", _alone("e_intentions.asl"), 12),
    Row("f", "f_achieve", "message (achieve)", (("ping", "f_ping.asl"), ("pong", "f_pong.asl")), 4, why=_MESSAGES),
    Row("f2", "f2_tell", "message (tell)", (("ping", "f2_ping.asl"), ("pong", "f2_pong.asl")), 4, why=_MESSAGES),
    Row("g", "g_findall_sort", "findall + sort", _alone("g_findall_sort.asl"), 6),
    Row(
        "h",
        "h_percept",
        "percept cycle",
        _alone("h_percept.asl"),
        4,
        environment="benchmarks.reasoner.counter:Counter",
        why=_PERCEPTS,
    ),
    Row(
        "h'",
        "h_percept",
        "percept cycle, embedded",
        _alone("h_percept.asl"),
        4,
        environment="benchmarks.reasoner.embedded",
        why=_PERCEPTS,
    ),
)
"""In the order of the report."""


def row_called(key: str) -> Row:
    """Return the row of that key. Raises KeyError."""
    return {row.key: row for row in ROWS}[key]


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
    """The reason for an exceeded limit, as far as it is known, and what was tried."""


def _median_of(times: int, measure: Callable[[], tuple[float, float]], which: int) -> float:
    return statistics.median(measure()[which] for _ in range(times))


def _first(program: str, which: int, most: int = 3, settle: float = 0.0) -> Callable[[Subject, int], float]:
    """Return what measures seconds until a program's first print (0) or MB then (1), at most so many times."""

    def measure(subject: Subject, times: int) -> float:
        command = subject.command([("ag", PROGRAMS / program)])
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
        command = subject.command([("ag", program)])
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
