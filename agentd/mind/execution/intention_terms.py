"""Intentions as terms, for ``.intention``."""

from __future__ import annotations

from typing import Any

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.nodes import Operator
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.from_ast import instantiate
from agentd.language.terms.terms import Code, Literal, atom, deref, make_list
from agentd.mind.beliefs.term_copy import resolve, resolve_all
from agentd.mind.beliefs.unification import undo, unify
from agentd.mind.data.intention import ANNOTS, ARGS, PLAN, RELEVANT, STEP, Frame, Intention, Step, values_of, wait_text
from agentd.mind.plans.plan_terms import label_with_line
from agentd.mind.state import MindState

_IM, _MAP, _WAITING, _SUSPENDED, _WAIT = (
    signature("im", 4),
    signature("map", 2),
    signature("waiting", 1),
    signature("suspended", 1),
    signature("wait", 1),
)

_CALLS = frozenset(
    {Operator.ACHIEVE, Operator.TEST, Operator.ADD, Operator.ADD_FIRST, Operator.ADD_LAST, Operator.UPDATE}
)
"""The operators whose events are plans of the same intention."""


def state_of(mind: MindState, intention: Intention) -> Literal:
    """``running``, ``waiting(Reason)``, ``suspended(Reason)``; ``pending`` while its event waits in the queue."""
    if intention.suspended is not None:
        return Literal(_SUSPENDED, (atom(intention.suspended),))
    if intention.waiting is not None:
        return Literal(_WAITING, (wait_text(intention.waiting),))
    if any(event[3] is intention for event in mind.events):
        return atom("pending")
    return atom("running")


def stack_of(mind: MindState, intention: Intention) -> Any:
    """``[im(Label, {Trigger}, {Body}, [map(Name, Value), ...]), ...]``, innermost plan first.

    A body begins with the formula that the plan is at: one that has begun (``!g`` until g is achieved) is part of it.
    """
    stack = intention.stack
    means = []
    for place, frame in enumerate(stack):
        if place + 1 < len(stack):
            begun = calling_step(frame, stack[place + 1])
        else:
            begun = None if intention in mind.running else intention.last
            if begun is not None and (begun.plan is not frame[PLAN] or intention.id in mind.suspended):
                begun = None
        means.append(_means(frame, begun))
    return make_list(reversed(means))


def calling_step(frame: Frame, above: Frame) -> Step | None:
    """Return the formula of a frame's plan that raised the event of the frame above it."""
    called = Literal(above[RELEVANT].sig, above[ARGS])
    values = values_of(frame)
    found: list[tuple[Step, Literal]] = []
    for step in frame[PLAN].steps:
        if step is None or step.next is not frame[STEP] or not isinstance(step.syntax, nodes.Step):
            continue
        term = deref(instantiate(step.syntax.term, dict(values)))
        if step.syntax.operator in _CALLS and type(term) is Literal and term.sig is called.sig:
            found.append((step, term))
    for step, term in found[:-1]:
        trail: list[Any] = []
        fits = unify(term, called, trail)
        undo(trail, 0)
        if fits:
            return step
    return found[-1][0] if found else None


def _means(frame: Frame, begun: Step | None) -> Literal:
    relevant, plan = frame[RELEVANT], frame[PLAN]
    values = {name: resolve(value) for name, value in values_of(frame).items()}
    trigger = nodes.Trigger(relevant.operator, relevant.goal, nodes.Variable("Goal"))
    goal = Literal(relevant.sig, resolve_all(frame[ARGS]), resolve_all(frame[ANNOTS]))
    steps = ahead(frame[STEP]) if begun is None else [begun, *ahead(frame[STEP])]
    body = Code(nodes.Body(tuple(s.syntax for s in steps)), values)
    bindings = make_list([Literal(_MAP, (name, value)) for name, value in values.items()])
    return Literal(_IM, (label_with_line(plan), Code(trigger, {"Goal": goal}), body, bindings))


def ahead(step: Step | None) -> list[Step]:
    """Return the formulas that a frame has still before it, in order; a loop is listed once."""
    found: list[Step] = []
    while step is not None and not any(step is other for other in found):
        found.append(step)
        step = step.next
    return found
