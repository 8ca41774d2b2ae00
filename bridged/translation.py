"""From what a robot says to beliefs: fields picked, converted and made terms as the manifest declares."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from bridged.drivers.robot import Reading
from bridged.paper_text import percept_value
from schemas.manifest import Field, Manifest, PerceptEntry
from schemas.terms import Term, number

DIGITS = 12
"""Significant digits kept after a conversion: -276036830 * 1e-7 is -27.603683 and nothing beyond."""


@dataclass(frozen=True, slots=True)
class Belief:
    """A percept as one reading gives it; no parameters = the source does not know it, or says that it is over."""

    name: str
    entry: PerceptEntry
    parameters: tuple[Term, ...] | None


class Translator:
    """The percepts of a manifest by their source."""

    def __init__(self, manifest: Manifest) -> None:
        self.unreadable = 0
        """Readings so far that lacked a field which the manifest names."""
        self._term = percept_value if manifest.robot.values == "text" else _term
        self._by_source: dict[str, list[tuple[str, PerceptEntry, tuple[Field, ...]]]] = {}
        for name, entry in manifest.percepts.items():
            self._by_source.setdefault(entry.source, []).append((name, entry, entry.fields()))

    def beliefs(self, reading: Reading) -> Iterator[Belief]:
        """Each percept of the reading's source."""
        for name, entry, fields in self._by_source.get(reading.source, ()):
            if reading.fields is None:
                yield Belief(name, entry, None)
                continue
            try:
                parameters = tuple(_argument(field, reading.fields, self._term) for field in fields)
            except _Absent:
                continue
            except (KeyError, IndexError, ValueError, TypeError):
                self.unreadable += 1
                continue
            yield Belief(name, entry, parameters)


class _Absent(Exception):
    """The robot says that it does not know the value."""


def _argument(field: Field, fields: Mapping[str, object], term: Callable[[object], Term]) -> Term:
    head, *rest = field.field.split(".")
    value = fields[head]
    for step in rest:
        value = value[int(step)] if isinstance(value, list | tuple) else _member(value, step)
    if field.absent is not None and value == field.absent:
        raise _Absent
    if isinstance(value, int | float) and not isinstance(value, bool) and (field.scale, field.offset) != (1.0, 0.0):
        value = float(f"{value * field.scale + field.offset:.{DIGITS}g}")
    return term(value)


def _member(value: object, step: str) -> object:
    if isinstance(value, Mapping):
        return value[step]
    raise TypeError(f"{step!r} of a {type(value).__name__}")


def _term(value: object) -> Term:
    match value:
        case bool() | int() | str():
            return value
        case float():
            return number(value)
        case bytes() | bytearray() | list() | tuple():
            return [_term(item) for item in value]
    raise TypeError(f"no term for a {type(value).__name__}")
