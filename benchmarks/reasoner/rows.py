"""The rows of the comparison: what is run, what counts as one operation, and what Jason was measured to do."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

PROGRAMS: Final = Path(__file__).parent / "programs"


@dataclass(frozen=True)
class Jason:
    """What Jason 3.3 (JRE 21, 2 x86 cores, medians of 5 runs) did beside python-agentspeak 0.2.2 in the same session.

    Absolute figures belong to that machine; `warm_ratio` and `cold_ratio` can be held against a run on any other.
    """

    warm: float
    """Operations per second, the median of the last two rounds."""
    cold: float | None
    """Operations per second in the first round; None where it was not recorded."""
    agentspeak: float
    """What python-agentspeak did there, warm. It does not warm up, so this stands for its first round too."""
    rss: float
    """Peak resident memory, MB."""

    @property
    def warm_ratio(self) -> float:
        return self.warm / self.agentspeak

    @property
    def cold_ratio(self) -> float | None:
        return None if self.cold is None else self.cold / self.agentspeak


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
    jason: Jason | None = None
    environment: str = ""
    """For the percept rows: ``module:Class`` of the environment, or the module that embeds agentd's mind itself."""
    why: str = ""
    """For a row whose target is hard to meet: the reason, and what was tried."""

    def paths(self) -> list[tuple[str, Path]]:
        return [(name, PROGRAMS / file) for name, file in self.agents]


def _alone(program: str) -> tuple[tuple[str, str], ...]:
    return (("ag", program),)


_MESSAGES: Final = (
    "The time is spent between the minds (turn, effect, message, event), where python-agentspeak has one call of a "
    "function; shortened where a count of instructions showed more than was needed ([mind.md](mind.md#speed))."
)
_PERCEPTS: Final = (
    "Each percept is an input and each action an effect that can be recorded and replayed; python-agentspeak's action "
    "is a call of a function. What a cycle costs is counted in [mind.md](mind.md#speed), and was shortened by it."
)

ROWS: Final = (
    Row("a", "a_goal_loop", "sub-goal", _alone("a_goal_loop.asl"), 12, Jason(697_745, 89_817, 48_362, 305)),
    Row("b", "b_belief_churn", "belief change", _alone("b_belief_churn.asl"), 12, Jason(525_277, 57_560, 28_900, 298)),
    Row("c0", "c0_fill_10k", "fact added", _alone("c_query_bound.asl"), 4, Jason(45_048, None, 37_271, 551)),
    Row("c", "c_query_bound", "look-up in 10,000", _alone("c_query_bound.asl"), 500, Jason(1_579, 658, 69, 551)),
    Row("c2", "c2_join", "pair of 500 x 500", _alone("c2_join.asl"), 20, Jason(3_252_602, 1_424_001, 509_066, 361)),
    Row("d", "d_fib", "rule call", _alone("d_fib.asl"), 12, Jason(257_893, 55_862, 13_551, 152)),
    Row("d2", "d2_path", "solution", _alone("d2_path.asl"), 6, Jason(23_033, 6_527, 2_947, 300)),
    Row("e", "e_intentions", "step of 1,000", _alone("e_intentions.asl"), 12, Jason(955_090, 185_599, 23_553, 411)),
    Row(
        "f",
        "f_achieve",
        "message (achieve)",
        (("ping", "f_ping.asl"), ("pong", "f_pong.asl")),
        4,
        Jason(190_999, 18_815, 43_679, 292),
        why=_MESSAGES,
    ),
    Row(
        "f2",
        "f2_tell",
        "message (tell)",
        (("ping", "f2_ping.asl"), ("pong", "f2_pong.asl")),
        4,
        Jason(137_101, 18_369, 21_190, 302),
        why=_MESSAGES,
    ),
    Row("g", "g_findall_sort", "findall + sort", _alone("g_findall_sort.asl"), 6, Jason(2_269, 311, 322, 290)),
    Row(
        "h",
        "h_percept",
        "percept cycle",
        _alone("h_percept.asl"),
        4,
        Jason(143_009, 29_763, 32_280, 305),
        "benchmarks.reasoner.counter:Counter",
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


def row_called(key: str) -> Row:
    """Return the row of that key. Raises KeyError."""
    return {row.key: row for row in ROWS}[key]
