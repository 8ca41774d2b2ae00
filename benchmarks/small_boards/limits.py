"""What the processes of a small board may use, and the cage that keeps them there: `cages` makes one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Final

LEAST: Final = 1_000
"""Microseconds: the smallest quota that the kernel takes."""
SHORTEST: Final = 10_000
"""Microseconds: a share is kept over no shorter period. (A long one makes no slow core but a fast one with pauses.)"""
ENTER: Final = 'while [ "$1" != -- ]; do echo $$ >> "$1" || exit 125; shift; done; shift; exec "$@"'
"""For a shell: write its number into each file up to `--`, then become the command behind it."""


@dataclass(frozen=True)
class Limits:
    """What processes may use together; None = all that there is."""

    memory: float | None = None
    """MB."""
    share: float | None = None
    """Of one core of this machine: what one core of theirs is."""
    cores: int = 1
    """Of theirs: all processes have `cores` times the share, and no process more than one."""


@dataclass(frozen=True)
class Usage:
    """What processes have used within a cage."""

    peak: float
    """MB that were charged to them at most."""
    throttled: float
    """Seconds in which they were held back, of each cage and each process in it together."""
    killed: int
    """Processes that were killed for memory."""


class Cage(ABC):
    """A set of processes under limits."""

    kind: str
    """In words, for pages."""

    @abstractmethod
    def command(self, argv: list[str]) -> list[str]:
        """Return how a process of the cage is started: by a shell that enters it and becomes the process."""

    @abstractmethod
    def charged(self) -> float:
        """Return the MB that count against the limit now."""

    @abstractmethod
    def usage(self) -> Usage:
        """Return what was used so far."""
