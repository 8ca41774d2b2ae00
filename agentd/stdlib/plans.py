"""The plan library: adding, removing and finding plans, and events by hand."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from agentd.language.syntax_tree import nodes
from agentd.language.terms.source_annotations import SELF
from agentd.language.terms.terms import Code, Literal, Term, Var, atom, deref, make_list
from agentd.mind.beliefs.term_copy import detach, resolve, resolve_all, with_source
from agentd.mind.beliefs.unification import Trail, alternatives, undo, unify
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.registry import internal_action
from agentd.mind.execution import waiting
from agentd.mind.plans.plan_terms import (
    add_plans,
    is_label,
    label_of,
    parts_of,
    plans_for,
    read_trigger,
    relevant_plans,
    remove_plans,
    term_of,
    trigger_literal,
)
from agentd.mind.state import MindState

_MYSELF, _BEGIN = SELF[0].args[0], atom("begin")


@internal_action(".add_plan", (1, 3))
def add_plan(mind: MindState, trail: Trail, plans: Term, source: Term = _MYSELF, place: Term | None = None) -> bool:
    """``.add_plan(P[, Source[, begin]])``: a plan in braces, its text, or a list of both.

    With the atom ``begin`` it is put before all others, with any other third argument after them.
    """
    add_plans(mind, plans, resolve(source), first=place is not None and resolve(place) == _BEGIN)
    return True


@internal_action(".remove_plan", (1, 2))
def remove_plan(mind: MindState, trail: Trail, plans: Term, source: Term = _MYSELF) -> bool:
    """``.remove_plan(Label[, Source])``: removes a source (the agent itself) from the plans with a label or labels.

    A plan is removed with its last source.
    """
    remove_plans(mind, plans, resolve(source))
    return True


@internal_action(".relevant_plans", (2, 3), pure=True)
def relevant(mind: MindState, trail: Trail, trigger: Term, plans: Term, labels: Term | None = None) -> bool:
    """``.relevant_plans({trigger}, Plans[, Labels])``: the plans for an event, as a list, and their labels."""
    if not unify(plans, make_list(relevant_plans(mind, trigger)), trail):
        return False
    if labels is None:
        return True
    return unify(labels, make_list([label_of(p) for p in plans_for(mind, read_trigger(mind, trigger))]), trail)


@internal_action(".relevant_plan", 2, backtracks=True, pure=True)
def relevant_plan(mind: MindState, trail: Trail, trigger: Term, plan: Term) -> Iterator[None]:
    """``.relevant_plan({trigger}, P)``: each plan for an event; of a given plan, its trigger."""
    given = deref(plan)
    if type(deref(trigger)) is Var and type(given) is Code and isinstance(given.syntax, nodes.Plan):
        yield from alternatives(trigger, [Code(given.syntax.trigger, given.values, bare=True)], trail)
    else:
        yield from alternatives(plan, relevant_plans(mind, trigger), trail)


@internal_action(".plan_label", 2, backtracks=True, pure=True)
def plan_label(mind: MindState, trail: Trail, plan: Any, label: Any) -> Iterator[None]:
    """``.plan_label(P, Label)``: each plan with its label; the label of a given plan."""
    mark = len(trail)
    wanted, given = deref(label), deref(plan)
    if type(wanted) is Var and type(given) is Code and is_label(getattr(given.syntax, "label", None)):
        yield from alternatives(label, parts_of(given)[:1], trail)
        return
    for found in list(mind.plans):
        if type(wanted) is Literal and wanted.sig.functor != found.label.sig.functor:
            continue
        if (type(wanted) is not Var or unify(wanted, label_of(found), trail)) and unify(plan, term_of(found), trail):
            yield None
        undo(trail, mark)


@internal_action(".signal", (1, 2))
def signal(mind: MindState, trail: Trail, trigger: Term, kind: Term | None = None) -> bool:
    """``.signal({+e})``: raises the event, with source(self); no belief is added."""
    if type(deref(trigger)) not in (Code, str):
        raise Failed("unknown", ".signal takes an event in braces, such as { +alarm(1) }")
    code = read_trigger(mind, trigger)
    literal = trigger_literal(code)
    event = mind.plans.relevant(code.syntax.operator, code.syntax.goal, literal.sig)
    args, annots = detach(resolve_all(literal.args)), with_source(resolve_all(literal.annots))
    waiting.signal(mind, event, args, annots)
    return True
