"""Variables that stand only once: most often a misspelt name."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from typing import TypeAlias

from agentd.analysis.mentions import Survey
from agentd.language.syntax import (
    And,
    Arithmetic,
    Body,
    BodyFormula,
    BodyTerm,
    For,
    Fork,
    If,
    InternalAction,
    ListTerm,
    Not,
    Or,
    Plan,
    PlanTerm,
    Relation,
    Rule,
    RuleTerm,
    Step,
    String,
    Structure,
    Term,
    Trigger,
    TriggerTerm,
    Variable,
    While,
)
from schemas.findings import Finding

_Node: TypeAlias = Term | Body | BodyFormula | Plan | Rule | Trigger

_IN_STRING = re.compile(r"#\{([A-Z]\w*)\}")
"""How ``.puts`` names variables in its text."""


def singletons(survey: Survey) -> Iterator[Finding]:
    """A warning for each named variable that stands once in its plan (with its sub-plans), rule or belief."""
    nested = {id(sub) for placed in survey.plans for sub in placed.plan.subplans}
    terms = {id(placed.plan) for family in survey.families for placed in family}
    plans = [p.plan for p in survey.plans if id(p.plan) in terms and id(p.plan) not in nested]
    scopes: list[_Node] = [*plans, *survey.rules, *(belief.literal for belief in survey.beliefs)]
    for scope in scopes:
        yield from _in_scope(scope)


def _in_scope(scope: _Node) -> Iterator[Finding]:
    counts: Counter[str] = Counter()
    first: dict[str, Variable] = {}
    pending: list[_Node] = [scope]
    while pending:
        node = pending.pop()
        if isinstance(node, Variable):
            counts[node.name] += 1
            first[node.name] = node
        elif isinstance(node, String):
            counts.update(_IN_STRING.findall(node.value))
        pending.extend(_children(node))
    for name, variable in first.items():
        if counts[name] == 1 and not variable.anonymous:
            place = variable.position
            message = f"the variable {name} stands only once; is it misspelt? if not, write _ or _{name}"
            yield Finding(place.file, place.line, place.column, message, "warning")


def _children(node: _Node) -> list[_Node]:
    match node:
        case Variable() | Structure():
            inside: list[_Node] = list(node.args) if isinstance(node, Structure) else []
            inside += [node.namespace] if isinstance(node.namespace, Variable) else []
            return inside + ([node.annotations] if node.annotations is not None else [])
        case InternalAction(args=terms) | Arithmetic(operands=terms):
            return list(terms)
        case ListTerm(items, tail):
            return [*items, *([tail] if tail is not None else [])]
        case Relation(left=left, right=right) | And(left, right) | Or(left, right):
            return [left, right]
        case Not(operand):
            return [operand]
        case PlanTerm(inner) | TriggerTerm(inner) | BodyTerm(inner) | RuleTerm(inner):
            return [inner]
        case Rule(head, body):
            return [head, body]
        case Trigger(literal=literal):
            return [literal]
        case Plan():
            parts = (node.label, node.trigger, node.context, node.goal_condition, node.body, *node.subplans)
            return [part for part in parts if part is not None]
        case _:
            return _of_body(node)


def _of_body(node: _Node) -> list[_Node]:
    match node:
        case Body(formulas):
            return list(formulas)
        case Step(term=term):
            return [term]
        case If(branches, otherwise):
            parts: list[_Node] = [part for branch in branches for part in branch]
            return parts if otherwise is None else [*parts, otherwise]
        case While(condition, body) | For(condition, body):
            return [condition, body]
        case Fork(branches=bodies):
            return list(bodies)
    return []
