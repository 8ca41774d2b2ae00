"""Programs into a running mind, and a mind's beliefs and plans as program text."""

from __future__ import annotations

from typing import Any

from agentd.language import syntax
from agentd.language.compile import CompiledProgram
from agentd.language.instantiate import Instantiation
from agentd.language.term_text import code_text, text
from agentd.language.terms import Code, Literal
from agentd.mind.beliefs import RuleClause
from agentd.mind.resolving import resolve


def include_program(mind: Any, program: CompiledProgram | None) -> None:
    """Add what a file holds: beliefs with their events, goals, plans. None: the file was not there (told already)."""
    if program is None:
        return
    for node in program.plans:
        mind.plans.add(mind.plans.make(node))
    for item in reversed(program.beliefs):
        if isinstance(item, syntax.Rule):
            mind.add_rule(item, {})
        else:
            mind.add_belief(Instantiation({}, {}).term(item.literal))
    for goal in program.goals:
        mind.add_goal(Instantiation({}, {}).term(goal.literal), goal.operator)


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
