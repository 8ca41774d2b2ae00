"""Checks the arguments of an action against its manifest, in words that help whoever wrote the plan."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bridged.drivers.robot import Value
from bridged.paper_text import argument
from schemas.manifest import ActionEntry, Manifest, Parameter, ParameterType, Values
from schemas.terms import Atom, Structure, Term, to_float
from schemas.text import read, write


class BadArgument(ValueError):
    """An argument that the action does not take; says which, what was expected and what came."""


def signature(name: str, entry: ActionEntry) -> str:
    """The action as its manifest declares it: `takeoff(altitude: float 1..120 m)`."""
    return f"{name}({', '.join(map(str, entry.params))})"


def read_arguments(
    name: str, entry: ActionEntry, parameters: Sequence[Term], values: Values = "typed"
) -> dict[str, Value]:
    """Return the arguments by name, as the robot's `values` say. Raises BadArgument for the first that is wrong."""
    if len(parameters) != entry.arity:
        raise BadArgument(f"{signature(name, entry)} takes {entry.arity} arguments, got {len(parameters)}")
    given = list(zip(entry.params, parameters, strict=True))
    if values == "text":
        given = [(parameter, argument(parameter, term)) for parameter, term in given]
    return {parameter.name: _read(name, parameter, term) for parameter, term in given}


def read_call(manifest: Manifest, text: str) -> tuple[str, dict[str, Value]]:
    """Return the action and the arguments that a text such as `cmd_vel(0, 0, 0)` says. Raises ValueError."""
    term = read(text)
    name, arguments = (term.functor, term.args) if isinstance(term, Structure) else (write(term), ())
    entry = manifest.actions.get(name)
    if entry is None:
        raise ValueError(f"`{text}`: the manifest has no action `{name}`")
    return name, read_arguments(name, entry, arguments, manifest.robot.values)


def _read(name: str, parameter: Parameter, term: Term) -> Value:
    for kind in parameter.types:
        value = _as(kind, term)
        if value is None:
            continue
        if isinstance(value, int | float) and not isinstance(value, bool) and not _in_range(parameter, value):
            break
        return value
    raise BadArgument(f"{name}: expected {parameter}, got {write(term)}")


def _as(kind: ParameterType, term: Term) -> Value | None:
    match kind:
        case "boolean":
            return term if isinstance(term, bool) else None
        case "string":
            return term.name.strip("'") if isinstance(term, Atom) else term if isinstance(term, str) else None
    number = to_float(term)
    if number is None or not math.isfinite(number):
        return None
    if kind == "int":
        return int(number) if number.is_integer() else None
    return number


def _in_range(parameter: Parameter, value: float) -> bool:
    low = -math.inf if parameter.min is None else parameter.min
    high = math.inf if parameter.max is None else parameter.max
    return low <= value <= high
