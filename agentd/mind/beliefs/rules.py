"""Rules of a mind: believed, forgotten, compiled for the modes in which they are asked."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

from agentd.language.compiler.compile_rule import compile_rule
from agentd.language.compiler.constants import signature_of
from agentd.language.syntax_tree import nodes
from agentd.language.terms.from_ast import instantiate
from agentd.language.terms.terms import Literal
from agentd.mind.beliefs.belief_base import Mode, RuleClause, use_open
from agentd.mind.beliefs.unification import Trail, undo
from agentd.mind.state import MindState

SCHEMA: Final = nodes.Structure("true")
"""The body of the rule that an initial belief with variables is (`agentd.mind.execution.program_loading`)."""


def add_rule(mind: MindState, rule: nodes.Rule, values: dict[str, Any], last: bool = False) -> None:
    """Believe a rule, before the other clauses of its predicate or after them."""
    clause = RuleClause(rule, partial(_compile_rule, mind), values)
    mind.beliefs.predicate(signature_of(rule.head)).add_rule(clause, last)
    mind.plans.note_formula(rule.body)
    if rule.head.functor == "select__option":
        mind.plans.choose_by_rule()
    mind.changes += 1


def remove_rule(mind: MindState, rule: nodes.Rule) -> None:
    """Forget the first rule that is written so."""
    predicate = mind.beliefs.predicate(signature_of(rule.head))
    for entry in list(predicate.entries):
        if type(entry) is RuleClause and entry.syntax == rule:
            predicate.remove_rule(entry)
            mind.changes += 1
            return


def remove_schema(mind: MindState, belief: Literal, trail: Trail) -> None:
    """Forget the first initial belief with variables that a belief leaves as it is: equal up to names of variables."""
    predicate, mark = mind.beliefs.predicate(belief.sig), len(trail)
    for entry in list(predicate.entries):
        if type(entry) is RuleClause and entry.syntax.body == SCHEMA:
            used = use_open(belief, instantiate(entry.syntax.head, dict(entry.values)), trail)
            if used is not None and used[1]:
                predicate.remove_rule(entry)
                mind.changes += 1
                return
            undo(trail, mark)


def _compile_rule(mind: MindState, clause: RuleClause, mode: Mode) -> Any:
    unit = compile_rule(clause.syntax, mode, mind.compiler, clause.values)
    answers = unit.load(mind.plans.runtime, mind.plans.provide)["answers"]
    return mind.open_beliefs.rule(answers) if mind.open_beliefs.installed else answers
