"""Generates the Python of single formulas: actions, goals, tests, belief changes and ``.wait`` for a formula."""

from __future__ import annotations

from typing import Any

from agentd.language import syntax
from agentd.language.compile_queries import QUERIES, is_query
from agentd.language.compile_terms import Scope
from agentd.language.computed_once import ComputedOnce
from agentd.language.constants import is_plain_atom, signature_of
from agentd.language.emit import Ref, tuple_of
from agentd.language.signatures import signature
from agentd.language.step_writer import StepWriter
from agentd.language.syntax import Operator
from agentd.language.variables import is_plain_variable, variables


def write_step(writer: StepWriter, formula: syntax.Step) -> None:
    """Write an operator and its term; the function is left open."""
    operator, term = formula.operator, formula.term
    match operator:
        case Operator.ACTION:
            _action(writer, term)
        case Operator.ACHIEVE | Operator.ACHIEVE_NEW_FOCUS:
            _achieve(writer, term, operator is Operator.ACHIEVE_NEW_FOCUS)
        case Operator.TEST:
            _test(writer, term)
        case _:
            _change(writer, operator, term)


def _action(writer: StepWriter, term: Any) -> None:
    match term:
        case syntax.InternalAction():
            _internal(writer, term)
        case syntax.Structure() if not isinstance(term.namespace, syntax.Variable):
            _external(writer, term)
        case syntax.Relation():
            scope = writer.use(term)
            writer.compiler.formula(term, scope, writer.succeed)
            writer.function.emit("constraint_failed()")
            writer.settle(term)
        case syntax.Variable():
            writer.dynamic(f"run_term(m, i, f, {writer.here()}, {{}})", term)
        case syntax.And() | syntax.Or():
            scope = writer.use(term)
            writer.compiler.formula(term, scope, writer.succeed)
            writer.function.emit("constraint_failed()")
            writer.settle(term)
        case _:
            writer.dynamic(f"run_term(m, i, f, {writer.here()}, {{}})", term)


def _achieve(writer: StepWriter, term: Any, new_focus: bool) -> None:
    if not isinstance(term, syntax.Structure) or isinstance(term.namespace, syntax.Variable):
        writer.dynamic(f"achieve_term(m, i, {{}}, {new_focus})", term)
        return
    args, annots, scope = writer.literal(term)
    relevant = writer.relevant("+", "!", term)
    if new_focus:
        if writer.body.library.has_meta:
            writer.function.emit(f"pending(m, {relevant}, {args}, {annots})")
        writer.function.emit(f"m.post({relevant}, detach({args}), {_resolved_annots(annots)})")
    else:
        writer.store(scope)
        if writer.body.library.has_meta:
            writer.function.emit(f"pending(m, {relevant}, {args}, {annots})")
        writer.function.emit(f"m.events.append(({relevant}, {args}, {annots}, i))")
        writer.function.emit("return True")
        writer.became(scope)


def _test(writer: StepWriter, term: Any) -> None:
    scope = writer.use(term)
    writer.compiler.formula(term, scope, writer.succeed)
    if isinstance(term, syntax.Structure) and not isinstance(term.namespace, syntax.Variable):
        after = dict(scope)
        args = tuple_of([writer.compiler.build(arg, after) for arg in term.args])
        annots = writer.compiler.event_annots(term.annotations, after)
        relevant = writer.relevant("+", "?", term)
        writer.function.emit(f"r = test_event(m, i, {relevant}, {args}, {annots})")
        writer.store(after)
        writer.function.emit("return r")
    elif isinstance(term, syntax.Variable):
        built = writer.compiler.build(term, dict(scope))
        writer.function.emit(f"return test_term(m, i, {built})")
    else:
        writer.function.emit("test_failed(m, i)")
    writer.settle(term)


def _external(writer: StepWriter, term: syntax.Structure) -> None:
    scope = writer.use(term)
    built = writer.function.assign(writer.compiler.build(term, scope))
    writer.store(scope)
    writer.function.emit(f"return perform(m, i, {built})")
    writer.became(scope)


def _internal(writer: StepWriter, term: syntax.InternalAction) -> None:
    name, arity = term.name, len(term.args)
    if name == ".wait" and arity <= 3 and arity and _is_condition(term.args[0]):
        _wait(writer, term)
        return
    scope = writer.use(term)
    query = QUERIES.get((name, arity))
    action = writer.body.library.action(name, arity)
    if query is not None and is_query(term.args[min(1, arity - 2)], scope):
        writer.compiler.formula(term, scope, writer.succeed)
        writer.function.emit("action_said_no()")
        writer.settle(term)
        return
    if action is None:
        writer.body.library.unknown_action(term)
        sig = writer.constant(signature(name, arity))
        args = tuple_of([writer.compiler.build(arg, scope) for arg in term.args])
        writer.store(scope)
        writer.function.emit(f"return perform(m, i, Literal({sig}, {args}))")
        writer.became(scope)
        return
    built = writer.compiler.action_arguments(term, scope)
    for place, arg in enumerate(term.args[: action.names]):
        if (
            isinstance(arg, syntax.Structure)
            and is_plain_atom(arg)
            and not writer.body.library.is_function(arg.functor, 0)
        ):
            built[place] = writer.constant(arg.functor)
    args = "".join(f", {writer.function.assign(arg)}" for arg in built)
    function = writer.constant(action.function)
    if action.suspends:
        writer.store(scope)
        writer.function.emit(f"return {function}(m, trail{args})")
    elif action.backtracks:
        with writer.function.block(f"for _ in {function}(m, trail{args}):"):
            writer.succeed_settled(scope)
        writer.function.emit("action_said_no()")
    else:
        with writer.function.block(f"if {function}(m, trail{args}):"):
            writer.succeed_settled(scope)
        writer.function.emit("action_said_no()")
    writer.became(scope)


def _change(writer: StepWriter, operator: Operator, term: Any) -> None:
    """Belief changes."""
    if not isinstance(term, syntax.Structure) or isinstance(term.namespace, syntax.Variable):
        writer.dynamic(f"change_term(m, i, {writer.constant(operator.value)}, {{}})", term)
        return
    args, annots, scope = writer.literal(term)
    predicate = writer.constant(Ref("predicate", signature_of(term)))
    focus = "None" if operator in (Operator.ADD_NEW_FOCUS, Operator.DELETE_NEW_FOCUS) else "i"
    match operator:
        case Operator.ADD | Operator.ADD_FIRST | Operator.ADD_NEW_FOCUS:
            plans = writer.relevant("+", "", term)
            added = f"{_resolved(writer, term, scope)}, {_resolved_annots(annots)}"
            call = f"believe(m, {focus}, {predicate}, {plans}, {added})"
        case Operator.ADD_LAST:
            plans = writer.relevant("+", "", term)
            added = f"{_resolved(writer, term, scope)}, {_resolved_annots(annots)}"
            call = f"believe(m, {focus}, {predicate}, {plans}, {added}, True)"
        case Operator.DELETE | Operator.DELETE_NEW_FOCUS:
            plans = writer.relevant("-", "", term)
            call = f"disbelieve(m, {focus}, {predicate}, {plans}, {args}, {annots}, trail)"
        case _:
            plans, gone = writer.relevant("+", "", term), writer.relevant("-", "", term)
            added = f"{_resolved(writer, term, scope)}, {_resolved_annots(annots)}"
            call = f"replace(m, {focus}, {predicate}, {plans}, {gone}, {added})"
    writer.store(scope)
    writer.function.emit(f"return {call}")
    writer.became(scope)


def _resolved(writer: StepWriter, term: syntax.Structure, scope: Scope) -> str:
    """The arguments of a belief to be added, without bound variables."""
    parts = []
    for arg in term.args:
        built = writer.function.assign(writer.compiler.build(arg, scope))
        if isinstance(arg, syntax.Number | syntax.String) or (
            isinstance(arg, syntax.Structure) and not arg.args and arg.annotations is None
        ):
            parts.append(built)
        else:
            parts.append(f"{built} if type({built}) is float else resolve({built})")
    return tuple_of(parts)


def _resolved_annots(annots: str) -> str:
    """An expression for annotations without bound variables; constants have none."""
    return annots if annots.isidentifier() else f"resolve_annots({annots})"


def _wait(writer: StepWriter, term: syntax.InternalAction) -> None:
    """``.wait(Formula[, Ms[, Elapsed]])``: the formula becomes a function that the mind asks after each change.

    Functions in it are computed before, once, as Jason does.
    """
    scope = writer.use(term)
    others = "".join(f", {writer.function.assign(writer.compiler.build(arg, scope))}" for arg in term.args[1:])
    formula = ComputedOnce(writer, scope).formula(term.args[0])
    writer.store(scope)
    check = writer.unit.name("w")
    writer.function.emit(f"return wait_until(m, i, f, {check}{others})")
    writer.became(scope)
    writer.finish()
    writer.start(check, writer.bound)
    inner = writer.use(formula)

    def holds(found: Scope) -> None:
        writer.store(found)
        writer.function.emit("return True")

    writer.compiler.formula(formula, inner, holds)
    writer.function.emit("return False")
    writer.became(dict.fromkeys(variables(formula), ""), certain=False)


def _is_condition(node: Any) -> bool:
    """Whether the first argument of ``.wait`` is a formula (not a time, an event or a variable)."""
    return isinstance(
        node, syntax.Structure | syntax.Relation | syntax.And | syntax.Or | syntax.Not | syntax.InternalAction
    ) and not is_plain_variable(node)
