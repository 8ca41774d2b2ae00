"""A mind's beliefs, rules and plans as program text that reads back the same, for ``.save_agent``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

from agentd.language import syntax
from agentd.language.printer import source_text
from agentd.language.term_text import code_text, text
from agentd.language.terms import Code, Literal, deref
from agentd.language.to_syntax import NoSyntax, ToSyntax
from agentd.mind.beliefs import RuleClause
from agentd.mind.effects import Log
from agentd.mind.plans import Plan
from agentd.mind.resolving import resolve

DEEPEST: Final = 1000
"""Terms nested deeper are left out of the text."""


def program_text(mind: Any, goals: list[Any]) -> str:
    """The program, with these initial goals. What cannot be written is left out, and told in the log."""
    lines: list[str] = []

    def add(shown: Callable[[], str], write: Callable[[ToSyntax], Any]) -> None:
        try:
            lines.append(source_text(write(ToSyntax(DEEPEST))))
        except NoSyntax as why:
            mind.effects.append(Log("warning", f".save_agent leaves out {shown()}: {why}"))

    for predicate in reversed(mind.beliefs.predicates()):  # initial beliefs come in from the last to the first
        for entry in reversed(predicate.entries.values()):
            if type(entry) is RuleClause:
                rule = Code(entry.syntax, entry.values, bare=True)
                add(lambda rule=rule: code_text(rule), lambda to, rule=rule: to.code(rule.syntax, rule.values))
            elif type(entry) is Literal:
                add(lambda fact=entry: text(fact), lambda to, fact=entry: syntax.Belief(to.term(fact)))
    for goal in goals:
        add(lambda goal=goal: text(goal), lambda to, goal=goal: _goal(to, goal))
    for plan in mind.plans:
        add(lambda plan=plan: plan.head, lambda to, plan=plan: _plan(to, plan))
    return "".join(f"{line}\n" for line in lines)


def _goal(to: ToSyntax, goal: Any) -> syntax.Goal:
    literal = deref(resolve(goal))
    if type(literal) is not Literal:
        raise NoSyntax("it is no goal")
    return syntax.Goal(to.term(literal))


def _plan(to: ToSyntax, plan: Plan) -> Any:
    """A plan with its label, generated ones too."""
    node = to.code(plan.syntax, plan.values)
    return replace(node, label=to.term(plan.label))
