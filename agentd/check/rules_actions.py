"""Actions, directives and performatives against those that exist; actions against their manifest."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

from agentd.check.external_knowledge import Arities, arguments, takes
from agentd.check.finding_kinds import Kind, finding, warning
from agentd.check.symbol_table import ANY_ARITY, Call, Mention, Survey
from agentd.language.compiler.compile import mistake_in
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.errors import near
from agentd.language.syntax_tree.nodes import Operator
from agentd.language.syntax_tree.printer import source_text
from schemas.files.findings import Finding, near_miss
from schemas.manifest.model import Parameter, Values
from schemas.mission.model import PERFORMATIVES


def external_actions(survey: Survey, known: Arities, internal: Arities) -> Iterator[Finding]:
    """Actions that the robot does not have, or with a wrong number of arguments."""
    goals = {placed.name for placed in survey.plans if placed.event == "+!"}
    for action in survey.actions:
        arities = known.get(action.name)
        if arities is None:
            hint = near(action.name, known)
            if action.name in goals:
                hint = f", did you mean the goal `!{action.name}`?"
            elif f".{action.name}" in internal:
                hint = f", did you mean the internal action `.{action.name}`?"
            text = f"there is no action {action.name}/{action.arity}{hint}"
            yield finding(Kind.UNKNOWN_ACTION, action.position, text)
        elif not takes(arities, action.arity):
            text = f"the action {action.name} takes {arguments(arities)}, not {action.arity}"
            yield finding(Kind.ACTION_ARITY, action.position, text)


def action_types(survey: Survey, parameters: Mapping[str, Sequence[Parameter]], values: Values) -> Iterator[Finding]:
    """Arguments written out in the program that the bridge would refuse; of those that go as texts, only numbers."""
    for action in survey.actions:
        expected = parameters.get(action.name, ())
        if sum(one.default is None for one in expected) <= action.arity <= len(expected):
            yield from _wrong_arguments(action, expected, values)


def _wrong_arguments(action: Mention, expected: Sequence[Parameter], values: Values) -> Iterator[Finding]:
    for parameter, term in zip(expected, action.literal.args, strict=False):  # those left out have a default
        if values == "text" and not (
            isinstance(term, nodes.Number | nodes.Arithmetic) and {"float", "int"}.issuperset(parameter.types)
        ):
            continue
        if not any(_may_be(kind, term, parameter) for kind in parameter.types):
            text = f"the action {action.name} takes {parameter}, not {source_text(term)}"
            place = action.position if term.position.line == 0 else term.position
            yield finding(Kind.ACTION_TYPE, place, text)


def _may_be(kind: str, term: nodes.Term, parameter: Parameter) -> bool:
    """Return whether a term can be an argument of a type; what only the run knows can be any."""
    match term:
        case nodes.Number(value):
            return _number(kind, value, parameter)
        case nodes.Arithmetic("-", (nodes.Number(value),)):
            return _number(kind, -value, parameter)
        case nodes.Arithmetic():
            return kind in ("float", "int")
        case nodes.String():
            return kind == "string"
        case nodes.Structure("true" | "false", ()):
            return kind == "boolean"
        case nodes.Structure(_, ()):
            return kind == "string"
        case nodes.ListTerm():
            return kind == "list"
        case nodes.Structure():
            return False
        case _:
            return True


def _number(kind: str, value: float, parameter: Parameter) -> bool:
    low = -math.inf if parameter.min is None else parameter.min
    high = math.inf if parameter.max is None else parameter.max
    fits = kind == "float" or (kind == "int" and value.is_integer())
    return fits and math.isfinite(value) and low <= value <= high


_OFTEN_UNDOTTED = frozenset(
    (".print", ".println", ".printf", ".send", ".broadcast", ".wait", ".concat", ".findall", ".my_name", ".stopMAS")
)
"""Internal actions that beginners write without their dot, and no environment has as actions of its own."""


def internal_actions(
    survey: Survey, actions: Arities, functions: Arities, unusable: Mapping[str, str]
) -> Iterator[Finding]:
    """Internal actions and functions that do not exist, or with a wrong number of arguments.

    ``unusable`` gives for packages that should provide some the reason why they cannot.
    """
    registered = {name for name, _ in survey.functions}
    for call in survey.calls:
        name, arity = call.action.name, len(call.action.args)
        if (name, arity) in survey.functions or (name, ANY_ARITY) in survey.functions:
            continue
        allowed = [table[name] for table in (actions, functions) if name in table]
        if not allowed and (reason := unusable.get(name.partition(".")[0])):
            yield finding(Kind.UNKNOWN_FUNCTION, call.action.position, f"{name}/{arity} cannot be used: {reason}")
        elif not allowed:
            yield _unknown(call, {*actions, *functions, *registered})
        elif not any(takes(arities, arity) for arities in allowed):
            text = " or ".join(arguments(arities) for arities in allowed)
            yield finding(Kind.INTERNAL_ACTION_ARITY, call.action.position, f"{name} takes {text}, not {arity}")


def _unknown(call: Call, known: Iterable[str]) -> Finding:
    action, becomes = call.action, "fails the plan that reaches it"
    kind, what = Kind.UNKNOWN_INTERNAL_ACTION, "internal action"
    if not action.name.startswith("."):
        kind, what = Kind.UNKNOWN_FUNCTION, "function or internal action"
        becomes = "stays a term without a value" if call.as_term else becomes
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
    for index, step in ((index, step) for body in survey.bodies for index, step in enumerate(body.formulas)):
        match step:
            case nodes.Step(Operator.ACTION, nodes.Not() | nodes.And() | nodes.Or()):
                text = "a logical formula in a body is performed as an action, and fails; test it: ?(...)"
                yield warning(Kind.FORMULA_AS_ACTION, step.position, text)
            case nodes.Step(Operator.ACTION, nodes.Structure("true" | "false" as word)) if index or word == "false":
                text = f"{word} in a body is performed as an action, and fails; only a first true is skipped"
                yield warning(Kind.FORMULA_AS_ACTION, step.position, text)


def wrong_directives(survey: Survey) -> Iterator[Finding]:
    """Directives that `agentd run` would refuse."""
    for directive in survey.directives:
        if mistake := mistake_in(directive):
            yield finding(Kind.UNKNOWN_DIRECTIVE, directive.position, mistake)


def directives_as_beliefs(survey: Survey) -> Iterator[Finding]:
    """``include("f.asl").``, a belief."""
    for belief in survey.beliefs:
        match belief.literal:
            case nodes.Structure("include" | "register_function", (nodes.String(), *_)) as literal:
                directive = f"{{ {source_text(literal)} }}"
                text = f"{literal.functor}(...) is a belief here; a directive is written in braces: {directive}"
                yield warning(Kind.DIRECTIVE_AS_BELIEF, literal.position, text)


def unknown_performatives(survey: Survey) -> Iterator[Finding]:
    """Performatives that are nearly one of those that exist; any other may be the agents' own."""
    for call in survey.calls:
        match call.action.name, call.action.args:
            case (".send", (_, nodes.Structure() as term, _, *_)) | (".broadcast", (nodes.Structure() as term, _)):
                if hint := near_miss(term.functor, PERFORMATIVES, 0.75):
                    text = f"{term.functor} is not a performative that agents handle by themselves{hint}"
                    yield warning(Kind.UNKNOWN_PERFORMATIVE, term.position, text)
