"""External actions against a manifest: that they exist, with so many arguments, of such types and in such ranges."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from agentd.analysis.arities import Arities, arguments, takes
from agentd.analysis.kinds import Kind, finding
from agentd.analysis.mentions import Mention, Survey
from agentd.language.printer import source_text
from agentd.language.spelling import near
from agentd.language.syntax import Arithmetic, ListTerm, Number, String, Structure, Term
from schemas.findings import Finding
from schemas.manifest_entries import Parameter, Values


def external_actions(survey: Survey, known: Arities, internal: Arities) -> Iterator[Finding]:
    """Actions that the robot does not know, or not with so many arguments."""
    goals = {placed.name for placed in survey.plans if placed.event == "+!"}
    for action in survey.actions:
        arities = known.get(action.name)
        if arities is None:
            hint = near(action.name, known)
            if action.name in goals:
                hint = f"; did you mean the goal !{action.name}?"
            elif f".{action.name}" in internal:
                hint = f"; did you mean the internal action .{action.name}?"
            text = f"there is no action {action.name}/{action.arity}{hint}"
            yield finding(Kind.UNKNOWN_ACTION, action.position, text)
        elif not takes(arities, action.arity):
            text = f"the action {action.name} takes {arguments(arities)}, not {action.arity}"
            yield finding(Kind.ACTION_ARITY, action.position, text)


def action_types(
    survey: Survey, parameters: Mapping[str, Sequence[Parameter]], values: Values = "typed"
) -> Iterator[Finding]:
    """Arguments written out in the program that the bridge would refuse; of those that go as texts, only numbers."""
    for action in survey.actions:
        expected = parameters.get(action.name, ())
        if sum(one.default is None for one in expected) <= action.arity <= len(expected):
            yield from _wrong_arguments(action, expected, values)


def _wrong_arguments(action: Mention, expected: Sequence[Parameter], values: Values) -> Iterator[Finding]:
    for parameter, term in zip(expected, action.literal.args, strict=False):  # those left out have a default
        if values == "text" and not (
            isinstance(term, Number | Arithmetic) and {"float", "int"}.issuperset(parameter.types)
        ):
            continue
        if not any(_may_be(kind, term, parameter) for kind in parameter.types):
            text = f"the action {action.name} takes {parameter}, not {source_text(term)}"
            place = action.position if term.position.line == 0 else term.position
            yield finding(Kind.ACTION_TYPE, place, text)


def _may_be(kind: str, term: Term, parameter: Parameter) -> bool:
    """Whether a term can be an argument of a type; what only the run knows can be any."""
    match term:
        case Number(value):
            return _number(kind, value, parameter)
        case Arithmetic("-", (Number(value),)):
            return _number(kind, -value, parameter)
        case Arithmetic():
            return kind in ("float", "int")
        case String():
            return kind == "string"
        case Structure("true" | "false", ()):
            return kind == "boolean"
        case Structure(_, ()):
            return kind == "string"
        case ListTerm():
            return kind == "list"
        case Structure():
            return False
        case _:
            return True


def _number(kind: str, value: float, parameter: Parameter) -> bool:
    low = -math.inf if parameter.min is None else parameter.min
    high = math.inf if parameter.max is None else parameter.max
    fits = kind == "float" or (kind == "int" and value.is_integer())
    return fits and math.isfinite(value) and low <= value <= high
