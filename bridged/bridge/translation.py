"""From what a robot says to beliefs: fields picked, converted and made terms as the manifest declares."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import msgspec

from bridged.drivers.api import Reading
from bridged.paper_format.text_values import percept_value
from schemas.manifest.loader import Field, Manifest, PerceptEntry
from schemas.wire.terms import Atom, Term, number

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

    def __init__(self, manifest: Manifest, unreadable: int = 0) -> None:
        self.unreadable = unreadable
        """Readings so far that lacked a field which the manifest names."""
        self._term = percept_value if manifest.robot.values == "text" else _term
        self._by_source: dict[tuple[str, str], list[tuple[str, PerceptEntry, tuple[Field, ...]]]] = {}
        own = manifest.robot.driver
        for name, entry in manifest.percepts.items():
            source = ("" if entry.driver == own else entry.driver, entry.source)
            self._by_source.setdefault(source, []).append((name, entry, entry.fields()))

    def beliefs(self, reading: Reading) -> Iterator[Belief]:
        """Each percept of the reading's source."""
        for name, entry, fields in self._by_source.get((reading.driver, reading.source), ()):
            if reading.fields is None:
                yield Belief(name, entry, None)
                continue
            try:
                parameters = tuple(_argument(field, reading.fields, self._term) for field in fields)
                if len(_ENCODE(parameters)) > LARGEST:
                    raise ValueError("too large to be told")
            except _Absent:
                if entry.buf == "update" and not entry.key:  # which of several it was is not known
                    yield Belief(name, entry, None)
                continue
            except (KeyError, IndexError, ValueError, TypeError, OverflowError, RecursionError):
                self.unreadable += 1
                continue
            yield Belief(name, entry, parameters)


LARGEST = 65_536
"""Bytes of the largest belief that is told; an agent must be able to take in each of them."""
_ENCODE = msgspec.msgpack.Encoder().encode
_LISTS, _NUMBERS = (list, tuple), (int, float)
"""Made once: a union is made anew wherever it is written, for each value that a robot says."""

ToTerm = Callable[[object], Term]
"""What makes a term of a plain value, by the robot's `values`."""


class _Absent(Exception):
    """The robot says that it does not know the value."""


def _argument(field: Field, message: object, term: ToTerm) -> Term:
    value = message
    for step in field.field.split("."):
        value = value[int(step)] if isinstance(value, _LISTS) else _member(value, step)
    if field.each:
        return _elements(field, value, term)
    if isinstance(value, _LISTS):
        return [_value(field, item, term) for item in value if not _is_absent(field, item)]
    if _is_absent(field, value):
        raise _Absent
    return _value(field, value, term)


def _elements(field: Field, value: object, term: ToTerm) -> list[Term]:
    """What is taken of each structure in a list; one that lacks a value that it may lack is left out."""
    if not isinstance(value, _LISTS):
        raise TypeError(f"a list was expected, not a {type(value).__name__}")
    parts = field.parts()
    found: list[Term] = []
    for element in value:
        try:
            taken = [_argument(part, element, term) for part in parts]
        except _Absent:
            continue
        alone = len(parts) == 1 and (bool(parts[0].each) or term is not percept_value)  # the paper wrapped `[](name)`
        found.append(taken[0] if alone else taken)
    return found


def _is_absent(field: Field, value: object) -> bool:
    return field.absent is not None and value == field.absent


def _value(field: Field, value: object, term: ToTerm) -> Term:
    """Convert a value, or every number in a list of lists."""
    if isinstance(value, _LISTS):
        return [_value(field, item, term) for item in value]
    if isinstance(value, _NUMBERS) and not isinstance(value, bool) and (field.scale, field.offset) != (1.0, 0.0):
        value = float(f"{value * field.scale + field.offset:.{DIGITS}g}")
    return term(value)


def _member(value: object, step: str) -> object:
    if isinstance(value, Mapping):
        return value[step]
    raise TypeError(f"{step!r} of a {type(value).__name__}")


def _term(value: object) -> Term:
    match value:
        case float():
            return number(value)
        case bool() | int() | str() | Atom():
            return value
        case bytes() | bytearray():
            return list(value)
    raise TypeError(f"no term for a {type(value).__name__}")
