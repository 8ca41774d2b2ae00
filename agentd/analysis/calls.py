"""External actions against a manifest, internal actions and functions against those that exist."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from difflib import get_close_matches
from typing import TypeAlias

from agentd.analysis.mentions import ANY_ARITY, Call, Survey
from agentd.language.syntax import And, Body, Not, Operator, Or, Position, Step, Structure
from schemas.findings import Finding

Arities: TypeAlias = Mapping[str, int | Collection[int]]
"""Names with the numbers of arguments that they take; a `range` is such a collection."""


def takes(arities: int | Collection[int], arity: int) -> bool:
    return arity == arities if isinstance(arities, int) else arity in arities


def finding(position: Position, message: str, *, warning: bool = False) -> Finding:
    return Finding(position.file, position.line, position.column, message, "warning" if warning else "error")


def near(word: str, known: Iterable[str]) -> str:
    """``; did you mean x?`` for a near miss or the same name in a namespace, else nothing."""
    names = sorted(known)
    close = [name for name in names if name.endswith(f"::{word}")] or get_close_matches(word, names, 1, 0.6)
    return f"; did you mean {close[0]}?" if close else ""


def arguments(arities: int | Collection[int]) -> str:
    """How many arguments something takes, in words."""
    if isinstance(arities, range) and len(arities) > 9:
        return f"at least {arities.start} argument{'s' * (arities.start != 1)}" if arities.start else "any arguments"
    numbers = [arities] if isinstance(arities, int) else sorted(arities)
    if numbers == [0]:
        return "no arguments"
    words = [str(number) for number in numbers]
    text = " or ".join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else words[0]
    return f"{text} argument{'s' * (numbers != [1])}"


def external_actions(survey: Survey, known: Arities) -> Iterator[Finding]:
    """Actions that the robot does not know, or not with so many arguments."""
    goals = {placed.name for placed in survey.plans if placed.event == "+!"}
    for action in survey.actions:
        arities = known.get(action.name)
        if arities is None:
            hint = f"; did you mean the goal !{action.name}?" if action.name in goals else near(action.name, known)
            yield finding(action.position, f"there is no action {action.name}/{action.arity}{hint}")
        elif not takes(arities, action.arity):
            text = f"the action {action.name} takes {arguments(arities)}, not {action.arity}"
            yield finding(action.position, text)


def internal_actions(survey: Survey, actions: Arities, functions: Arities) -> Iterator[Finding]:
    """Internal actions and functions that do not exist, or not with so many arguments."""
    registered = {name for name, _ in survey.functions}
    for call in survey.calls:
        name, arity = call.action.name, len(call.action.args)
        if (name, arity) in survey.functions or (name, ANY_ARITY) in survey.functions:
            continue
        allowed = _merged(name, actions, functions)
        if allowed is None:
            yield finding(call.action.position, _unknown(call, {*actions, *functions, *registered}))
        elif not any(takes(arities, arity) for arities in allowed):
            text = " or ".join(arguments(arities) for arities in allowed)
            yield finding(call.action.position, f"{name} takes {text}, not {arity}")


def _merged(name: str, *tables: Arities) -> list[int | Collection[int]] | None:
    found = [table[name] for table in tables if name in table]
    return found or None


def _unknown(call: Call, known: Iterable[str]) -> str:
    name = call.action.name
    kind = "internal action" if name.startswith(".") else "function or internal action"
    what = "stays a term without a value" if call.as_term and not name.startswith(".") else "fails where it is reached"
    return f"there is no {kind} {name}/{len(call.action.args)}: it {what}{near(name, known)}"


def endless_asks(survey: Survey) -> Iterator[Finding]:
    """Synchronous asks that wait for ever when the receiver gives no answer."""
    for call in survey.calls:
        match call.action.name, call.action.args:
            case ".send", (_, Structure(functor), _, _) if functor in ("askOne", "askAll", "askHow"):
                text = "this ask has no time limit and may never end; give one in ms as fifth argument of .send"
                yield finding(call.action.position, text, warning=True)


def formulas_as_actions(survey: Survey) -> Iterator[Finding]:
    """Formulas in bodies that read like tests and are performed as actions, which fail."""
    for body in survey.bodies:
        yield from _formulas_as_actions(body)


def _formulas_as_actions(body: Body) -> Iterator[Finding]:
    for index, step in enumerate(body.formulas):
        match step:
            case Step(Operator.ACTION, Not() | And() | Or()):
                text = "a logical formula in a body is performed as an action, and fails; test it: ?(...)"
                yield finding(step.position, text, warning=True)
            case Step(Operator.ACTION, Structure("true" | "false" as word)) if index or word == "false":
                text = f"{word} in a body is performed as an action, and fails; only a first true is skipped"
                yield finding(step.position, text, warning=True)
