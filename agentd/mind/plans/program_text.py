"""A mind's beliefs, rules and plans as program text that reads back the same, for ``.save_agent``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.printer import source_text
from agentd.language.terms.format import text
from agentd.language.terms.terms import Code, Literal, deref
from agentd.language.terms.to_ast import NoSyntax, ToSyntax
from agentd.mind.beliefs.belief_base import RuleClause
from agentd.mind.beliefs.term_copy import resolve
from agentd.mind.data.effects import Log
from agentd.mind.plans.plan_library import Plan
from agentd.mind.state import MindState

DEEPEST: Final = 1000
"""Terms nested deeper are left out of the text."""


def program_text(mind: MindState, goals: list[Any]) -> str:
    """The program, with these initial goals. What cannot be written is left out, and told in the log."""
    lines: list[str] = []

    def put(write: Callable[[ToSyntax, Any], Any], what: Any) -> None:
        try:
            lines.append(source_text(write(ToSyntax(DEEPEST), what)))
        except NoSyntax as why:
            shown = what.head if type(what) is Plan else text(what)
            mind.effects.append(Log("warning", f".save_agent leaves out {shown}: {why}"))

    for predicate in reversed(mind.beliefs.predicates()):  # initial beliefs come in from the last to the first
        for entry in reversed(predicate.entries.values()):
            if type(entry) is RuleClause:
                put(_rule, Code(entry.syntax, entry.values, bare=True))
            elif type(entry) is Literal:
                put(_belief, entry)
    for goal in goals:
        put(_goal, deref(resolve(goal)))
    for plan in mind.plans:
        put(_plan, plan)
    return "".join(f"{line}\n" for line in lines)


def _rule(to: ToSyntax, rule: Code) -> Any:
    return to.code(rule.syntax, rule.values)


def _belief(to: ToSyntax, fact: Literal) -> Any:
    return nodes.Belief(to.term(fact))


def _goal(to: ToSyntax, goal: Any) -> Any:
    if type(goal) is not Literal:
        raise NoSyntax("it is no goal")
    return nodes.Goal(to.term(goal))


def _plan(to: ToSyntax, plan: Plan) -> Any:
    """A plan with its label, generated ones too."""
    return replace(to.code(plan.syntax, plan.values), label=to.term(plan.label))
