"""Internal actions and functions against those that exist."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping

from agentd.analysis.arities import Arities, arguments, takes
from agentd.analysis.kinds import Kind, finding, warning
from agentd.analysis.mentions import ANY_ARITY, Call, Survey
from agentd.language.spelling import near
from agentd.language.syntax import And, Body, Not, Operator, Or, Step, Structure
from schemas.findings import Finding

_OFTEN_UNDOTTED = frozenset(
    (".print", ".println", ".printf", ".send", ".broadcast", ".wait", ".concat", ".findall", ".my_name", ".stopMAS")
)
"""Internal actions that beginners write without their dot, and no environment has as actions of its own."""


def internal_actions(
    survey: Survey, actions: Arities, functions: Arities, unusable: Mapping[str, str] | None = None
) -> Iterator[Finding]:
    """Internal actions and functions that do not exist, or not with so many arguments.

    ``unusable`` says of packages that should provide some why they cannot.
    """
    registered = {name for name, _ in survey.functions}
    for call in survey.calls:
        name, arity = call.action.name, len(call.action.args)
        if (name, arity) in survey.functions or (name, ANY_ARITY) in survey.functions:
            continue
        allowed = _merged(name, actions, functions)
        if allowed is None and unusable and (reason := unusable.get(name.partition(".")[0])):
            yield finding(Kind.UNKNOWN_FUNCTION, call.action.position, f"{name}/{arity} cannot be used: {reason}")
        elif allowed is None:
            yield _unknown(call, {*actions, *functions, *registered})
        elif not any(takes(arities, arity) for arities in allowed):
            text = " or ".join(arguments(arities) for arities in allowed)
            yield finding(Kind.INTERNAL_ACTION_ARITY, call.action.position, f"{name} takes {text}, not {arity}")


def _merged(name: str, *tables: Arities) -> list[int | Collection[int]] | None:
    found = [table[name] for table in tables if name in table]
    return found or None


def _unknown(call: Call, known: Iterable[str]) -> Finding:
    action = call.action
    dotted = action.name.startswith(".")
    kind, what = (Kind.UNKNOWN_INTERNAL_ACTION, "internal action") if dotted else (Kind.UNKNOWN_FUNCTION, "function")
    if not dotted:
        what += " or internal action"
    becomes = "stays a term without a value" if call.as_term and not dotted else "fails where it is reached"
    text = f"there is no {what} {action.name}/{len(action.args)}: it {becomes}{near(action.name, known)}"
    return finding(kind, action.position, text)


def undotted_internal_actions(survey: Survey, internal: Arities) -> Iterator[Finding]:
    """``print("x")`` where ``.print("x")`` is meant; with a manifest it is an unknown action."""
    for action in survey.actions:
        dotted = f".{action.name}"
        if dotted in _OFTEN_UNDOTTED and dotted in internal:
            text = f"{action.name} without a dot is an action of the environment; the internal action is {dotted}"
            yield warning(Kind.UNDOTTED_INTERNAL_ACTION, action.position, text)


def formulas_as_actions(survey: Survey) -> Iterator[Finding]:
    """Formulas in bodies that read like tests and are performed as actions, which fail."""
    for body in survey.bodies:
        yield from _formulas_as_actions(body)


def _formulas_as_actions(body: Body) -> Iterator[Finding]:
    for index, step in enumerate(body.formulas):
        match step:
            case Step(Operator.ACTION, Not() | And() | Or()):
                text = "a logical formula in a body is performed as an action, and fails; test it: ?(...)"
                yield warning(Kind.FORMULA_AS_ACTION, step.position, text)
            case Step(Operator.ACTION, Structure("true" | "false" as word)) if index or word == "false":
                text = f"{word} in a body is performed as an action, and fails; only a first true is skipped"
                yield warning(Kind.FORMULA_AS_ACTION, step.position, text)
