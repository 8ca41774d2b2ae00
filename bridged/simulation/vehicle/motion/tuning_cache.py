"""How a vehicle moves by its parameters, made anew only when one of them has changed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, Protocol, TypeVar


class Changing(Protocol):
    """Values that count their changes."""

    changes: int


P = TypeVar("P", bound=Changing)
T = TypeVar("T")


class TuningCache(Generic[P, T]):
    """The tuning that `make` derives from parameters and the speed of legs (m/s; None: that of the parameters)."""

    def __init__(self, parameters: P, make: Callable[[P, float | None], T]) -> None:
        self._parameters, self._make = parameters, make
        self._made_of: tuple[float | None, int] | None = None
        self._tuning: T

    def __call__(self, speed: float | None) -> T:
        """Return the present tuning."""
        made_of = speed, self._parameters.changes
        if made_of != self._made_of:
            self._made_of, self._tuning = made_of, self._make(self._parameters, speed)
        return self._tuning
