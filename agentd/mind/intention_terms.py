"""Intentions as terms, for ``.intention``."""

from __future__ import annotations

from typing import Any

from agentd.language import syntax
from agentd.language.signatures import signature
from agentd.language.terms import Code, Literal, atom, make_list
from agentd.mind.frames import ANNOTS, ARGS, PLAN, RELEVANT, STEP, Frame, Step
from agentd.mind.intentions import Intention, values_of
from agentd.mind.resolving import resolve, resolve_all

_IM, _MAP, _WAITING, _SUSPENDED = (
    signature("im", 4),
    signature("map", 2),
    signature("waiting", 1),
    signature("suspended", 1),
)


def state_of(mind: Any, intention: Intention) -> Literal:
    """``running``, ``waiting(Reason)``, ``suspended(Reason)``; ``pending`` while its event waits in the queue."""
    if intention.suspended is not None:
        return Literal(_SUSPENDED, (atom(intention.suspended),))
    if intention.waiting is not None:
        return Literal(_WAITING, (intention.waiting,))
    if any(event[3] is intention for event in mind.events):
        return atom("pending")
    return atom("running")


def stack_of(intention: Intention) -> Any:
    """``[im(Label, {Trigger}, {Body ahead}, [map(Name, Value), ...]), ...]``."""
    return make_list([_means(frame) for frame in reversed(intention.stack)])


def _means(frame: Frame) -> Literal:
    relevant, plan = frame[RELEVANT], frame[PLAN]
    values = {name: resolve(value) for name, value in values_of(frame).items()}
    trigger = syntax.Trigger(relevant.operator, relevant.goal, syntax.Variable("Goal"))
    goal = Literal(relevant.sig, resolve_all(frame[ARGS]), resolve_all(frame[ANNOTS]))
    body = Code(syntax.Body(tuple(s.syntax for s in ahead(frame[STEP]))), values)
    bindings = make_list([Literal(_MAP, (name, value)) for name, value in values.items()])
    return Literal(_IM, (plan.label, Code(trigger, {"Goal": goal}), body, bindings))


def ahead(step: Step | None) -> list[Step]:
    """The formulas that a frame has still before it, in order; a loop is listed once."""
    found: list[Step] = []
    while step is not None and not any(step is other for other in found):
        found.append(step)
        step = step.next
    return found
