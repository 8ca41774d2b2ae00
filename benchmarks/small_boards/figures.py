"""What is flown within limits, and what was found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from benchmarks.small_boards.limits import Limits

THREE, ONE = "three daemons", "`argosy board`"
FORMS: Final = (THREE, ONE)


@dataclass(frozen=True)
class Wanted:
    """A flight to be flown."""

    form: str
    limits: Limits
    speed: float
    board: str = ""


@dataclass(frozen=True)
class Flown:
    """One flight, and what the board's daemons used for it."""

    board: str
    form: str
    memory: float | None
    """MB that they were allowed."""
    share: float | None
    """Of a core of this machine, for each of the board's cores."""
    cores: int
    kept_by: str
    completed: bool = False
    why: str = ""
    """For one that was not completed."""
    ready: float = 0.0
    """Seconds from the start until all daemons were there."""
    mission: float = 0.0
    """Seconds from then until the mission was done."""
    charged: float = 0.0
    """MB that counted against the limit, at most."""
    elsewhere: float = 0.0
    """MB that they held besides: pages of libraries that were charged to others, who had read them before."""
    cpu: float = 0.0
    """Per cent of a core in flight."""
    throttled: float = 0.0
    """Seconds in which they were held back."""
    lag: float = 0.0
    """Seconds by which a daemon's loop was late in flight, at worst."""
    timed_out: int = 0
    """Actions that were not done within their deadline."""

    @property
    def held(self) -> float:
        """MB in all."""
        return self.charged + self.elsewhere


@dataclass(frozen=True)
class Figures:
    """What was flown."""

    shares: list[Flown]
    """With shares of one core, and as much memory as there is."""
    boards: list[Flown]
    """With the limits of boards."""
    memory: list[Flown]
    """With little memory, and all that there is of the processor."""
    free: list[Flown]
    """Without limits, one of each form."""
    side_by_side: int
    """Flights at once, at most."""
    busy: float
    """Cores of the machine that were busy meanwhile, in the mean."""
