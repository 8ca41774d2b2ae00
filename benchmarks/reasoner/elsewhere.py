"""What Jason was measured to do elsewhere, beside python-agentspeak: `benchmarks/results/jason-elsewhere.json`.

It is no result of `make bench`, which has a table of its own for a Jason that is found on the machine. Absolute figures
belong to that machine; its ratios to python-agentspeak can be held against a run on another, roughly: what a compiler
at run time gains over an interpreter differs from processor to processor.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

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
    """What python-agentspeak did there, warm. It does not warm up, so this stands for its first round too."""
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


def load(file: Path = FILE) -> Elsewhere:
    """Read it. Raises msgspec.ValidationError for a file of another shape."""
    return msgspec.json.decode(file.read_bytes(), type=Elsewhere)


ELSEWHERE: Final = load()
