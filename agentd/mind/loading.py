"""Programs into a mind: when it begins, when it includes a file, when it is a clone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from agentd.language import syntax
from agentd.language.compile import CompiledProgram
from agentd.language.instantiate import Instantiation
from agentd.language.signatures import DEFAULT
from agentd.mind.beliefs import RuleClause
from agentd.mind.effects import Log
from agentd.mind.failed import as_failed
from agentd.mind.functions import FunctionsOf, by_rule
from agentd.mind.percepts import perceived
from agentd.mind.plan_terms import refuse_label
from agentd.mind.rules import add_rule


def load_program(mind: Any, program: CompiledProgram) -> None:
    """Give a new mind its program: functions, plans, initial beliefs and goals, and tell the warnings."""
    register_functions(mind, program.functions)
    mind.compiler.namespaced |= program.namespaced
    mind.plans.extend(list(program.plans))
    _begin(mind, program)
    warn(mind, program)


def include_program(mind: Any, program: CompiledProgram | None, namespace: str = DEFAULT) -> None:
    """Add what a file holds: beliefs with their events, goals, plans. None: the file was not there (told already).

    Fails with ``internal_action``, before anything is added, where a label is taken already; other namespaces than the
    default one have labels of their own.
    """
    if program is None:
        return
    if namespace == DEFAULT:
        for node in program.plans:
            refuse_label(mind, node.label)
    register_functions(mind, program.functions)
    mind.compiler.namespaced |= program.namespaced
    for node in program.plans:
        mind.plans.add(mind.plans.make(node))
    _begin(mind, program)
    warn(mind, program)


def register_functions(mind: Any, functions: Iterable[tuple[str, int, str]]) -> None:
    """Let rules compute functions: the name and number of arguments of each, and the name of the rule."""
    for name, arity, rule in functions:
        mind.compiler.register_function(name, arity, by_rule(rule, arity))
        mind.compiler.rules_of_functions[(name, arity)] = rule


def warn(mind: Any, program: CompiledProgram) -> None:
    """Tell the warnings of a program."""
    for warning in program.warnings:
        mind.effects.append(Log("warning", warning))


def _begin(mind: Any, program: CompiledProgram) -> None:
    """Believe the initial beliefs, begin with the initial goals."""
    functions = FunctionsOf(mind)
    for item in reversed(program.beliefs):
        if isinstance(item, syntax.Rule):
            add_rule(mind, item, {})
            continue
        with _left_out(mind, item):
            mind.add_belief(Instantiation({}, functions).term(item.literal))
    for goal in program.goals:
        with _left_out(mind, goal):
            mind.add_goal(Instantiation({}, functions).term(goal.literal), goal.operator)


@contextmanager
def _left_out(mind: Any, item: syntax.Belief | syntax.Goal) -> Iterator[None]:
    """Leave out a belief or goal that is nested too deep, or whose functions raise whatever they may, and say so."""
    try:
        yield
    except Exception as error:
        why = "is nested too deep" if isinstance(error, RecursionError) else f"cannot be computed: {as_failed(error)}"
        message = f"{item.position}: {item.literal.functor}/{len(item.literal.args)} {why}; it is left out"
        mind.effects.append(Log("error", message))


def copy_mind(mind: Any, other: Any) -> None:
    """Take over another mind's functions, beliefs, rules and plans, without their events (``.clone``)."""
    mind.compiler.copy_functions(other.compiler)
    for predicate in other.beliefs.predicates():
        own = mind.beliefs.predicate(predicate.sig)
        for entry in list(predicate.entries.values()):
            if type(entry) is RuleClause:
                add_rule(mind, entry.syntax, entry.values)
            else:
                own.add(entry.args, entry.annots)
    for sig, present in other.percepts.items():
        perceived(mind, sig).args.update(present.args)
    for plan in other.plans:
        copy = mind.plans.make(plan.syntax, plan.values)
        copy.label, copy.sources = plan.label, list(plan.sources)
        mind.plans.add(copy)
