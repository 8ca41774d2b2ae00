"""Belief operators of plan bodies, the events that they raise, and the rules of a mind."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

from agentd.language.compiler.constants import signature_of
from agentd.language.compiler.units import compile_rule
from agentd.language.syntax_tree import nodes
from agentd.language.terms.from_ast import instantiate
from agentd.language.terms.source_annotations import SELF
from agentd.language.terms.terms import Code, Literal, Open, Term, Var, deref
from agentd.mind.beliefs.belief_base import Mode, Predicate, RuleClause, use_open
from agentd.mind.beliefs.term_copy import closed, detach, is_ground, resolve, resolve_all, resolve_annots, with_source
from agentd.mind.beliefs.unification import Trail, undo
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.intention import Intention
from agentd.mind.execution.waiting import hear
from agentd.mind.plans.plan_library import Relevant
from agentd.mind.state import MindState


def believe(
    mind: MindState,
    focus: Intention | None,
    predicate: Predicate,
    relevant: Relevant,
    args: tuple[Term, ...],
    annots: tuple[Term, ...],
    last: bool = False,
) -> bool | None:
    """``+b``, all of it resolved: true when the intention has to wait for the plan of the event."""
    return believed(mind, focus, relevant, args, predicate.add(args, annots, last))


def believed(
    mind: MindState,
    focus: Intention | None,
    relevant: Relevant,
    args: tuple[Term, ...],
    new: tuple[Term, ...] | None,
) -> bool | None:
    """Raise the event of an added belief; ``new`` are the annotations that it did not have, None if it had all."""
    if new is None:
        return None
    mind.changes += 1
    if relevant.plans and focus is not None and not mind.listeners:
        mind.events.append((relevant, args, new, focus))
        return True
    return raise_event(mind, focus, relevant, args, new)


def add_belief(mind: MindState, literal: Literal) -> None:
    """Believe a literal, with its event as an intention of its own."""
    predicate = mind.beliefs.predicate(literal.sig)
    relevant = mind.plans.relevant("+", "", literal.sig)
    annots = resolve_annots(with_source(literal.annots))
    believe(mind, None, predicate, relevant, detach(resolve_all(literal.args)), annots)


def raise_event(
    mind: MindState, focus: Intention | None, relevant: Relevant, args: tuple[Term, ...], annots: tuple[Term, ...]
) -> bool | None:
    """Return the event of a belief change, in the focus of an intention or (None) as a new one."""
    if mind.listeners:
        hear(mind, relevant, args, annots)
    if relevant.plans or mind.plans.has_nested:
        if focus is None:
            mind.post(relevant, args, annots)
            return None
        mind.events.append((relevant, args, annots, focus))
        return True
    if focus is not None and mind.events and mind.atomic is not focus:
        # No plan, but the event takes its turn in the queue as every other: the intention goes on after it. An atomic
        # plan does not wait for the others' turns.
        mind.events.append((relevant, args, annots, focus))
        return True
    return None


def disbelieve(
    mind: MindState,
    focus: Intention | None,
    predicate: Predicate,
    relevant: Relevant,
    args: tuple[Term, ...],
    annots: tuple[Term, ...],
    trail: Trail,
) -> bool | None:
    """``-b``: removes the first belief that unifies; its variables stay bound. No match is no failure."""
    fact = None if predicate.open else predicate.entries.get(args)
    found = annots
    if fact is not None and fact.annots is annots:
        predicate.remove(fact)
    else:
        fact = predicate.find(args, annots, trail)
        if fact is None:
            if predicate.rules:
                remove_schema(mind, Literal(predicate.sig, args, annots), trail)
            return None
        if annots is not SELF:
            found = resolve_all(annots)
        predicate.take_annots(fact, found)
    mind.changes += 1
    if relevant.plans and focus is not None and not mind.listeners:
        mind.events.append((relevant, fact.args, found, focus))
        return True
    return raise_event(mind, focus, relevant, fact.args, found)


def replace(
    mind: MindState,
    focus: Intention | None,
    predicate: Predicate,
    relevant: Relevant,
    gone: Relevant,
    args: tuple[Term, ...],
    annots: tuple[Term, ...],
) -> bool | None:
    """``-+b``, all resolved: takes the annotations written from the first entry that has them, then adds (49, 50).

    They include source(self) unless another source is written. A rule is an entry with source(self), as in Jason, and
    its removal raises no event.
    """
    for fact in reversed(predicate.entries.values()):
        if type(fact) is not Literal:
            if annots is SELF:
                predicate.remove_rule(fact)
                mind.changes += 1
                break
        elif fact.annots is annots or all(a in fact.annots for a in annots):
            predicate.take_annots(fact, annots)
            mind.changes += 1
            raise_event(mind, None, gone, fact.args, annots)
            break
    return believe(mind, focus, predicate, relevant, args, annots)


def known_value(term: Term) -> Any:
    """Return what a variable in a body holds. Fails with ``body_var_without_value`` if it is free (rule 62)."""
    term = deref(term)
    if type(term) is Open:
        term = closed(term)
    if type(term) is Var:
        raise Failed("body_var_without_value", f"The variable '{term.name}' must be ground.")
    return term


def change_term(mind: MindState, intention: Intention, operator: str, term: Term) -> bool | None:
    """Return a belief operator applied to a literal, rule or plan that only the run knows."""
    term = known_value(term)
    if type(term) is Code:
        _change_code(mind, operator, term)
        return None
    if type(term) is not Literal:
        raise Failed("body_var_not_literal", "The term is not a literal.")
    predicate = mind.beliefs.predicate(term.sig)
    focus = None if operator in ("++", "--") else intention
    added, gone = mind.plans.relevant("+", "", term.sig), mind.plans.relevant("-", "", term.sig)
    annots = with_source(term.annots)
    if operator in ("-", "--"):
        return disbelieve(mind, focus, predicate, gone, term.args, annots, intention.trail)
    args, annots = tuple([resolve(a) for a in detach(term.args)]), resolve_annots(annots)
    if operator == "-+":
        return replace(mind, focus, predicate, added, gone, args, annots)
    return believe(mind, focus, predicate, added, args, annots, operator == "+>")


def _change_code(mind: MindState, operator: str, code: Code) -> None:
    """``+{ rule }``, ``+{ plan }`` and their removal."""
    values = {name: resolve(v) for name, v in code.values.items() if is_ground(v)}
    if isinstance(code.syntax, nodes.Rule):
        if operator.startswith("-") and operator != "-+":
            remove_rule(mind, code.syntax)
        else:
            add_rule(mind, code.syntax, values, last=operator == "+>")
    elif isinstance(code.syntax, nodes.Plan):
        if operator in ("-", "--"):
            name = getattr(code.syntax.label, "functor", "")
            for plan in [plan for plan in mind.plans if plan.label.sig.functor == name]:
                mind.plans.remove(plan)
        else:
            mind.plans.add(mind.plans.make(code.syntax, values), first=operator != "+>")
    else:
        raise Failed("body_var_not_literal", "Only literals, rules and plans can be added.")


# --- rules ---


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
