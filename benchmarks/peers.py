"""Figures that others have measured and published: data with a source; none of them was measured here.

The paper is *Embedded Architecture Composed of Cognitive Agents and ROS for Programming Intelligent Robots*: agents in
Jason 2 with rosjava, and Python programs in their place, on Raspberry Pi 3 (1 GB) with ArduPilot SITL on another
computer. Jason's speed beside python-agentspeak is with the programs that were run: `benchmarks.reasoner.rows`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from benchmarks.processes import MEGABYTE

PI_MEMORY: Final = 975.7
"""MiB that the Raspberry Pi 3 of the paper's own data has; its per cents of memory are of this."""


def mb(mib: float) -> float:
    """Return MiB in the MB (10^6 bytes) of our own results."""
    return mib * 1024**2 / MEGABYTE


PI_MB: Final = mb(PI_MEMORY)
"""MB of a Raspberry Pi 3, as its kernel reports them."""
BEAGLEBONE_MB: Final = 512.0
"""MB that a BeagleBone Black is taken to have: less than its chips' 512 MiB, as its kernel keeps some for itself."""


@dataclass(frozen=True)
class Usage:
    """What a board used over a mission, in per cent."""

    mean: float
    std: float
    max: float


@dataclass(frozen=True)
class Board:
    """One row of the paper's tables 3 and 5: all processes of one board."""

    cpu: Usage
    memory: Usage


@dataclass(frozen=True)
class Size:
    """One row of the paper's tables 4 and 6."""

    bytes: int
    """Compressed by gzip."""
    lines: int
    words: int


TABLE_3: Final[dict[str, Board]] = {
    "Python": Board(Usage(1.65, 0.20, 2.61), Usage(17.45, 0.00, 17.45)),
    "Jason": Board(Usage(4.22, 2.25, 14.59), Usage(40.37, 0.06, 40.51)),
}
"""The single-UAV mission, by approach."""

TABLE_4: Final[dict[str, Size]] = {"Python": Size(518, 49, 112), "Jason": Size(344, 26, 64)}
"""Programs of the single-UAV mission."""

TABLE_5: Final[dict[str, dict[str, Board]]] = {
    "Python": {
        "Scout": Board(Usage(1.73, 0.17, 2.30), Usage(19.78, 0.00, 19.78)),
        "Rescuer 1": Board(Usage(1.78, 0.42, 4.02), Usage(19.61, 0.00, 19.64)),
        "Rescuer 2": Board(Usage(1.76, 0.27, 3.67), Usage(17.99, 0.00, 18.01)),
        "ALL": Board(Usage(1.76, 0.31, 4.02), Usage(18.93, 0.85, 19.78)),
    },
    "Jason": {
        "Scout": Board(Usage(4.68, 1.56, 8.61), Usage(43.81, 0.06, 43.87)),
        "Rescuer 1": Board(Usage(3.95, 1.57, 16.00), Usage(44.00, 0.06, 44.15)),
        "Rescuer 2": Board(Usage(3.94, 1.08, 8.86), Usage(43.14, 0.03, 43.18)),
        "ALL": Board(Usage(4.07, 1.42, 16.00), Usage(43.64, 0.40, 44.15)),
    },
}
"""Search and rescue, by approach and board."""

TABLE_6: Final[dict[str, Size]] = {"Python": Size(3668, 384, 928), "Jason": Size(2473, 260, 569)}
"""Programs of search and rescue, all agents together."""


@dataclass(frozen=True)
class Process:
    """One process of the paper's boards: lowest and highest of its runs."""

    memory: tuple[float, float]
    """MiB."""
    cpu: tuple[float, float]
    """Per cent of a core."""


PROCESSES: Final[dict[str, Process]] = {
    "Jason agent": Process((262, 267), (8.7, 12)),
    "Python agent": Process((22, 23), (0.8, 0.9)),
}
"""Per process, of the measurements published with the paper."""
JASON_BOARD: Final = (393.0, 430.0)
PYTHON_BOARD: Final = (165.0, 190.0)
"""MiB of all of a board's processes there, with the agent in Jason and in Python."""
BEAGLEBONE: Final = "out of memory each time"
"""What became of the paper's agents on a BeagleBone Black (512 MB)."""
