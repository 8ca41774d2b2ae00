"""Programs into a running mind, and a mind's beliefs and plans as program text."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from agentd.language import syntax
from agentd.language.compile import CompiledProgram
from agentd.language.instantiate import Instantiation
from agentd.language.term_text import code_text, text
from agentd.language.terms import Code, Literal
from agentd.mind.beliefs import RuleClause
from agentd.mind.effects import Log
from agentd.mind.functions import by_rule
from agentd.mind.resolving import resolve
from agentd.mind.rules import add_rule
from agentd.stdlib.registry import FUNCTIONS


def load_program(mind: Any, program: CompiledProgram) -> None:
    """Give a new mind its program: functions, plans, initial beliefs and goals, and tell the warnings."""
    for name, arity, rule in program.functions:
        mind.compiler.register_function(name, arity, by_rule(rule, arity))
    mind.plans.extend(list(program.plans))
    functions = {key: _bound_function(mind, key) for key in FUNCTIONS}
    for item in reversed(program.beliefs):
        if isinstance(item, syntax.Rule):
            add_rule(mind, item, {})
            continue
        with _too_deep(mind, item):
            mind.add_belief(Instantiation({}, functions).term(item.literal))
    for goal in program.goals:
        with _too_deep(mind, goal):
            mind.add_goal(Instantiation({}, functions).term(goal.literal), goal.operator)
    for warning in program.warnings:
        mind.effects.append(Log("warning", warning))


def _bound_function(mind: Any, key: tuple[str, int]) -> Callable[..., Any]:
    compute = mind.compiler.function(*key)
    return lambda *args: compute(mind, *args)


def include_program(mind: Any, program: CompiledProgram | None) -> None:
    """Add what a file holds: beliefs with their events, goals, plans. None: the file was not there (told already)."""
    if program is None:
        return
    for node in program.plans:
        mind.plans.add(mind.plans.make(node))
    for item in reversed(program.beliefs):
        if isinstance(item, syntax.Rule):
            add_rule(mind, item, {})
            continue
        with _too_deep(mind, item):
            mind.add_belief(Instantiation({}, {}).term(item.literal))
    for goal in program.goals:
        with _too_deep(mind, goal):
            mind.add_goal(Instantiation({}, {}).term(goal.literal), goal.operator)


@contextmanager
def _too_deep(mind: Any, item: syntax.Belief | syntax.Goal) -> Iterator[None]:
    """Leave out a belief or goal that is nested deeper than terms may be, and say so."""
    try:
        yield
    except RecursionError:
        message = f"{item.position}: {item.literal.functor}/{len(item.literal.args)} is nested too deep; it is left out"
        mind.effects.append(Log("error", message))


def program_text(mind: Any, goals: list[Any]) -> str:
    """The beliefs, rules and plans of a mind as a program that reads back the same, with these initial goals."""
    lines: list[str] = []
    for predicate in mind.beliefs.predicates():
        for entry in reversed(predicate.entries.values()):
            if type(entry) is RuleClause:
                lines.append(f"{code_text(Code(entry.syntax, entry.values, bare=True))}.")
            elif type(entry) is Literal:
                lines.append(f"{text(entry)}.")
    lines += [f"!{text(resolve(goal))}." for goal in goals]
    lines += [f"{code_text(Code(plan.syntax, plan.values, bare=True))}." for plan in mind.plans]
    return "\n".join(lines) + "\n"


def copy_mind(mind: Any, other: Any) -> None:
    """Take over another mind's beliefs, rules and plans, without their events (``.clone``)."""
    for predicate in other.beliefs.predicates():
        own = mind.beliefs.predicate(predicate.sig)
        for entry in list(predicate.entries.values()):
            if type(entry) is RuleClause:
                add_rule(mind, entry.syntax, entry.values)
            else:
                own.add(entry.args, entry.annots)
    mind.percepts = {sig: dict(present) for sig, present in other.percepts.items()}
    known = {id(plan.syntax) for plan in mind.plans}
    for plan in other.plans:
        if id(plan.syntax) not in known:
            mind.plans.add(mind.plans.make(plan.syntax, plan.values))
