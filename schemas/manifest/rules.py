"""Rules for the fields of a manifest entry beyond their types, and the names that the bridge itself provides.

A rule gets an entry and yields each problem at its path below the entry. It does not run while a field that it reads is
wrong itself, so that one mistake is reported once.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from schemas.files.units import Duration
from schemas.manifest.model import (
    ActionEntry,
    Field,
    FieldValue,
    Parameter,
    ParameterType,
    PerceptEntry,
    RobotEntry,
    Value,
)

BRIDGE_ACTIONS: dict[str, ActionEntry] = {
    "release": ActionEntry(motion=False, deadline=Duration(1)),
    "hand_over": ActionEntry(params=(Parameter(name="agent", type="string"),), motion=False, deadline=Duration(1)),
}
"""Actions of every bridge: `release` ends the lease of the robot, `hand_over(Agent)` gives it to another of its agents
(docs/reference/actions.md)."""
BRIDGE_ACTION_ARITIES: dict[str, int] = {name: entry.arity for name, entry in BRIDGE_ACTIONS.items()}
BRIDGE_PERCEPTS: dict[str, int] = {
    "bridge": 1,
    "override": 1,
    "restarted": 1,
    "holder": 1,
    "feedback": 3,
    "link": 1,
    "paused": 1,
}
"""Percepts of every bridge, which a program may use although no manifest declares them, and their arities:
`bridge(up)`, `override(Mode)`, `restarted(N)`, `holder(Agent)`, `feedback(Action, What, Value)`, `link(State)`,
`paused(Who)`."""


Wrong = tuple[tuple[str, ...], str]
"""Path below the entry, and the problem."""
Rule = Callable[[Any], Iterator[Wrong]]

FUNCTOR = re.compile(r"[a-z][A-Za-z0-9_]*", re.ASCII)
RESERVED = {
    "percepts": {
        "bridge": "whether it is there",
        "feedback": "progress of running actions, from the bridge",
        "holder": "which of its agents has the robot",
        "paused": "that the operator has paused the robot",
    },
    "actions": {
        "hand_over": "how an agent hands the robot to another one",
        "release": "how an agent lets go of the robot",
    },
}
"""Names that no manifest may use, and what the bridge uses them for."""
NUMBERS = frozenset({"float", "int"})
MAX_NUMBER = 2**63
"""No message has room for a larger constant."""


def name_problems(table: str, name: str) -> Iterator[str]:
    """Yield why an entry cannot have this name."""
    if not FUNCTOR.fullmatch(name):
        yield f"expected the name of a belief or action, such as `battery`, got `{name}`"
    elif meaning := RESERVED[table].get(name):
        yield f"`{name}` is a name of the bridge: {meaning}"


def _driver(entry: RobotEntry) -> Iterator[Wrong]:
    if not entry.driver:
        yield ("driver",), "expected the name of a driver, such as `mavlink`"


def _lasts(field: str) -> tuple[frozenset[str], Rule]:
    """Return the rule that a duration, if there is one, is more than 0 s."""

    def more_than_0(entry: Any) -> Iterator[Wrong]:
        if (seconds := getattr(entry, field)) is not None and seconds <= 0:
            yield (field,), "expected more than 0 s"

    return frozenset({field}), more_than_0


def _source(entry: PerceptEntry) -> Iterator[Wrong]:
    if not entry.source.strip():
        yield ("source",), "expected where the driver has it from, such as a message or key"


def _paths(fields: Iterable[Field], where: tuple[str, ...]) -> Iterator[Wrong]:
    for index, field in enumerate(fields):
        if not all(field.field.split(".")):
            yield (*where, str(index)), f"`{field.field}` is not a field path such as `voltages.0`"
        yield from _paths(field.parts(), (*where, str(index), "each"))


def _key(entry: PerceptEntry) -> Iterator[Wrong]:
    for index, position in enumerate(entry.key):
        if position >= entry.arity:
            counted = "there are no arguments" if not entry.arity else f"the arguments are 0..{entry.arity - 1}"
            yield ("key", str(index)), f"no argument at position {position}; {counted}"
        elif position in entry.key[:index]:
            yield ("key", str(index)), f"position {position} is repeated"


def _kept(entry: PerceptEntry) -> Iterator[Wrong]:
    """Check the fields that are for `buf = "update"` only."""
    for field, there in (("key", entry.key), ("deadband", entry.deadband)):
        if entry.buf == "add" and there:
            yield (field,), '`buf = "add"` keeps every one; this is for `update`'


def _params(entry: ActionEntry) -> Iterator[Wrong]:
    yield from _parameters(entry.params, ("params",))
    for index, parameter in enumerate(entry.params):
        here = ("params", str(index), "default")
        if problem := default_problem(parameter):
            yield here, problem
        if lacking := needs_default(entry.params[: index + 1]):
            yield here, lacking


def default_problem(parameter: Parameter) -> str:
    """Return why the default of a parameter is not a valid argument; empty if it is."""
    value, low, high = parameter.default, parameter.min, parameter.max
    if value is None:
        return ""
    fits = any(_is_a(kind, value) for kind in parameter.types)
    if isinstance(value, int | float):
        fits &= (low is None or low <= value) and (high is None or value <= high)
    return "" if fits else f"expected {parameter.expected()}, got `{str(value)[:40]}`"


def needs_default(parameters: Sequence[Parameter]) -> str:
    """Return why the last of these parameters needs a default; empty if it has one or needs none."""
    if not parameters or parameters[-1].default is not None:
        return ""
    before = next((one.name for one in parameters if one.default is not None), "")
    return f"`{parameters[-1].name}` needs a default, because `{before}` before it has one" if before else ""


def _is_a(kind: ParameterType, value: Value) -> bool:
    match kind:
        case "boolean" | "string":
            return isinstance(value, bool if kind == "boolean" else str)
        case "int":
            return isinstance(value, int) and not isinstance(value, bool)
        case "float":
            return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    return False


def _parameters(parameters: tuple[Parameter, ...], where: tuple[str, ...]) -> Iterator[Wrong]:
    names = [parameter.name for parameter in parameters]
    for index, parameter in enumerate(parameters):
        here = (*where, str(index))
        if not all(parameter.name.split(".")):
            yield (*here, "name"), f"expected a name, got `{parameter.name}`"
        elif parameter.name in names[:index]:
            yield (*here, "name"), f"`{parameter.name}` is repeated"
        if not parameter.types:
            yield (*here, "type"), "expected at least one type"
        yield from _range(parameter, here)
        if parameter.each and "list" not in parameter.types:
            yield (*here, "each"), '`each` is for `type = "list"`'
        if any(one.default is not None for one in parameter.each):
            yield (*here, "each"), "only an argument can have a default"
        yield from _parameters(parameter.each, (*here, "each"))


def _range(parameter: Parameter, here: tuple[str, ...]) -> Iterator[Wrong]:
    for bound, figure in (("min", parameter.min), ("max", parameter.max)):
        if figure is not None and not NUMBERS & set(parameter.types):
            yield (*here, bound), f"a range is for numbers; `{parameter.name}` is a {' or '.join(parameter.types)}"
    if parameter.min is not None and parameter.max is not None and parameter.min > parameter.max:
        yield (*here, "min"), f"`{parameter.name}` has min {parameter.min:g} above max {parameter.max:g}"


def _fields(entry: ActionEntry) -> Iterator[Wrong]:
    named = [parameter.name for parameter in entry.params]
    for field, value in entry.fields.items():
        where = ("fields", field)
        if isinstance(value, FieldValue):
            if bool(value.param) == (value.value is not None):
                yield where, "expected either `param` or `value`"
                continue
            refers, constant = value.param, value.value
        else:
            refers, constant = (value, None) if isinstance(value, str) else ("", value)
        if isinstance(constant, int | float) and not -MAX_NUMBER < constant < MAX_NUMBER:
            yield where, f"expected a number of at most 64 bits, got `{str(constant)[:40]}`"
        elif refers and refers not in named:
            yield where, f"no parameter `{refers}`; there is {', '.join(dict.fromkeys(named)) or 'none'}"
        elif value == "":
            yield where, "expected the name of a parameter; a text is `{value = ...}`"


def _ways(entry: ActionEntry) -> Iterator[Wrong]:
    ways = list(entry.ways())
    if len(ways) != 1:
        got = " and ".join(f"`{way}`" for way in ways) or "none of them"
        where = () if not ways else (ways[-1],)
        yield where, f"expected one of `command`, `message`, `topic`, `service` and `call`, got {got}"


def _feedback(entry: ActionEntry) -> Iterator[Wrong]:
    names = entry.feedback or ()
    for index, name in enumerate(names):
        if not FUNCTOR.fullmatch(name):
            yield ("feedback", str(index)), f"expected the name of a figure, such as `distance`, got `{name}`"
        elif name in names[:index]:
            yield ("feedback", str(index)), f"`{name}` is repeated"


RULES: dict[type, tuple[tuple[frozenset[str], Rule], ...]] = {
    RobotEntry: (
        (frozenset({"driver"}), _driver),
        _lasts("link_loss"),
    ),
    PerceptEntry: (
        (frozenset({"source"}), _source),
        (frozenset({"args"}), lambda entry: _paths(entry.fields(), ("args",))),
        (frozenset({"key", "args"}), _key),
        (frozenset({"buf", "key", "deadband"}), _kept),
        _lasts("ttl"),
    ),
    ActionEntry: (
        (frozenset({"params"}), _params),
        (frozenset({"fields", "params"}), _fields),
        (frozenset({"command", "message", "topic", "service", "call"}), _ways),
        (frozenset({"feedback"}), _feedback),
        _lasts("deadline"),
    ),
}
"""By kind of entry: the fields that a rule reads, and the rule."""
