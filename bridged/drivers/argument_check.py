"""Check the arguments of an action against its manifest, with errors for the author of the plan."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bridged.drivers.api import Value
from bridged.paper_format.text_values import argument
from schemas.files.findings import Finding
from schemas.humanize import count
from schemas.manifest.loader import ActionEntry, Argument, FieldValue, Manifest, Parameter, ParameterType, Values
from schemas.wire.term_text import BadTerm, read, write
from schemas.wire.terms import Atom, Structure, Term

MAX_SHOWN = 80
"""Characters of an argument that an error shows."""


class BadArgument(ValueError):
    """An argument that the action does not take: which one, what was expected and what was given."""


def signature(name: str, entry: ActionEntry) -> str:
    """Return the action as its manifest declares it: `takeoff(altitude: float 1..120 m)`."""
    return f"{name}({', '.join(map(str, entry.params))})"


def read_arguments(
    name: str, entry: ActionEntry, parameters: Sequence[Term], values: Values = "typed"
) -> dict[str, Argument]:
    """Return the arguments by name, as the robot's `values` say: lists of structures as lists of `dict`.

    Raises BadArgument for the first that is wrong.
    """
    least, most = sum(one.default is None for one in entry.params), len(entry.params)
    if not least <= len(parameters) <= most:
        taken = f"{least} to " if least < most else ""
        raise BadArgument(f"{signature(name, entry)} takes {taken}{count(most, 'argument')}, got {len(parameters)}")
    reader = _Reader(name, values)
    given = zip(entry.params, parameters, strict=False)  # those left out have a default
    return {one.name: one.default for one in entry.params if one.default is not None} | {
        parameter.name: reader.read(parameter.name, parameter, term) for parameter, term in given
    }


def read_call(manifest: Manifest, text: str) -> tuple[str, dict[str, Argument]]:
    """Return the action and the arguments that a text such as `cmd_vel(0, 0, 0)` says. Raises ValueError."""
    term = read(text)
    name, arguments = (term.functor, term.args) if isinstance(term, Structure) else (write(term), ())
    entry = manifest.actions.get(name)
    if entry is None:
        known = ", ".join(f"{one}/{action.arity}" for one, action in manifest.actions.items())
        raise BadArgument(f"`{text}`: the manifest has no action `{name}`; it has {known or 'none'}")
    return name, read_arguments(name, entry, arguments, manifest.robot.values)


def order_problems(manifest: Manifest) -> Iterator[Finding]:
    """Yield the manifest's orders that no action carries out, each at its line."""
    for order, text in manifest.orders.items():
        try:
            read_call(manifest, text)
        except BadTerm as error:
            problem = f"expected an action with its arguments, such as `cmd_vel(0, 0)`, got `{text}`: {error}"
            yield manifest.finding(f"orders.{order}: {problem}", "orders", order)
        except BadArgument as error:
            yield manifest.finding(f"orders.{order}: {error}", "orders", order)


def foreign_fields(manifest: Manifest, name: str, driver: str, foreign: Sequence[str]) -> Iterator[Finding]:
    """Yield fields of an action that only other drivers have; a driver but `mavlink` has no tables of values either."""
    entry, bare = manifest.actions[name], ActionEntry()
    for field in foreign:
        if getattr(entry, field) != getattr(bare, field):
            problem = f"actions.{name}.{field}: the driver `{driver}` has no `{field}`"
            yield manifest.finding(problem, "actions", name, field)
    for path, value in fields_of(entry).items():
        if value.table:
            problem = f"actions.{name}.fields.{path}: the driver `{driver}` has no table `{value.table}`"
            yield manifest.finding(problem, "actions", name, "fields", path)


def fields_of(entry: ActionEntry) -> dict[str, FieldValue]:
    """Return the value of each field of an action; without `fields` each parameter is the field of its name."""
    if not entry.fields:
        return {parameter.name: FieldValue(param=parameter.name) for parameter in entry.params}
    return {name: FieldValue.written_out(declared) for name, declared in entry.fields.items()}


def filled(what: str, declared: FieldValue, arguments: Mapping[str, Value]) -> Any:
    """Return a field with its argument filled in and converted; `what` names it in errors. Raises ValueError."""
    value = declared.value if declared.value is not None or not declared.param else arguments[declared.param]
    if (declared.scale, declared.offset) == (1.0, 0.0):
        return value
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{what}: expected a number, got {value!r}")
    return value * declared.scale + declared.offset


@dataclass(frozen=True)
class _Reader:
    """Reads the arguments of one call."""

    name: str
    values: Values

    def read(self, place: str, parameter: Parameter, term: Term) -> Argument:
        """Read one argument, or one value within it; `place` says which, such as `points[1].lat`."""
        if self.values == "text":
            term = argument(parameter, term)
        for kind in parameter.types:
            if kind == "list" and isinstance(term, list):
                return [self.element(f"{place}[{index}]", parameter, item) for index, item in enumerate(term)]
            value = _as(kind, term)
            if value is None:
                continue
            if isinstance(value, int | float) and not isinstance(value, bool):
                low = -math.inf if parameter.min is None else parameter.min
                high = math.inf if parameter.max is None else parameter.max
                if not low <= value <= high:
                    break
            return value
        raise self.unfit(place, parameter.expected(), term)

    def element(self, place: str, parameter: Parameter, term: Term) -> Argument | dict[str, Argument]:
        """Read one element of a list: a structure by the names in `each`, or a plain value."""
        if not parameter.each:
            return self.plain(place, term)
        if len(parameter.each) == 1 and not isinstance(term, list):
            term = [term]
        if not isinstance(term, list) or len(term) != len(parameter.each):
            raise self.unfit(place, f"[{', '.join(map(str, parameter.each))}]", term)
        return {
            one.name: self.read(f"{place}.{one.name}", one, item)
            for one, item in zip(parameter.each, term, strict=True)
        }

    def plain(self, place: str, term: Term) -> Argument:
        """Read a value that the manifest does not describe."""
        if isinstance(term, list):
            return [self.plain(f"{place}[{index}]", item) for index, item in enumerate(term)]
        if isinstance(term, bool | int | float | str):
            return term
        if isinstance(term, Atom):
            return term.name.strip("'")
        raise self.unfit(place, "a number, text, boolean or list", term)

    def unfit(self, place: str, expected: str, term: Term) -> BadArgument:
        text = write(term)
        shown = text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}..."
        return BadArgument(f"{self.name}: expected {place}: {expected}, got {shown}")


def _as(kind: ParameterType, term: Term) -> Argument | None:
    match kind:
        case "boolean":
            return term if isinstance(term, bool) else None
        case "string":
            return term.name.strip("'") if isinstance(term, Atom) else term if isinstance(term, str) else None
        case "list":
            return None
    if isinstance(term, bool) or not isinstance(term, int | float) or not math.isfinite(number := float(term)):
        return None
    if kind == "int":
        return int(number) if number.is_integer() else None
    return number
