"""The parameters that a simulated autopilot stores."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import IntEnum


class Kind(IntEnum):
    """param_type of PARAM_VALUE (MAV_PARAM_TYPE)."""

    INT8 = 2
    INT16 = 4
    INT32 = 6
    REAL32 = 9


_RANGES = {Kind.INT8: (-128, 127), Kind.INT16: (-32768, 32767), Kind.INT32: (-(2**31), 2**31 - 1)}
Row = tuple[str, float, Kind]
"""Name, default and type of a parameter."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter with the fields of PARAM_VALUE."""

    name: str
    value: float
    kind: Kind
    index: int


class Parameters:
    """All parameters of one vehicle. They survive a restart."""

    def __init__(self, rows: Iterable[Row]) -> None:
        self._rows: dict[str, tuple[int, Kind]] = {}
        self._values: dict[str, float] = {}
        for index, (name, default, kind) in enumerate(rows):
            self._rows[name], self._values[name] = (index, kind), float(default)
        self._names = list(self._values)
        self.changes = 0
        """How often one was changed."""

    def __len__(self) -> int:
        return len(self._names)

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def __iter__(self) -> Iterator[Parameter]:
        return (Parameter(name, self._values[name], kind, index) for name, (index, kind) in self._rows.items())

    def find(self, name: str) -> Parameter | None:
        """Return the parameter of a name, None if there is none."""
        if name not in self._values:
            return None
        index, kind = self._rows[name]
        return Parameter(name, self._values[name], kind, index)

    def at(self, index: int) -> Parameter | None:
        """Return the parameter at an index of the list."""
        return self.find(self._names[index]) if 0 <= index < len(self._names) else None

    def set(self, name: str, value: float) -> bool:
        """Store a value in the range of the parameter's type; returns whether it changed. Raises KeyError."""
        _, kind = self._rows[name]
        if not math.isfinite(value):
            return False
        if kind in _RANGES:
            low, high = _RANGES[kind]
            value = float(max(low, min(high, round(value))))
        changed = self._values[name] != value
        self._values[name] = value
        self.changes += changed
        return changed
