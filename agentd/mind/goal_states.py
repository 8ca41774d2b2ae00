"""Events about the states of goals, ``^!g[state(S)]``, for programs that have plans for them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from agentd.language.order import sorted_annots
from agentd.language.signatures import signature
from agentd.language.terms import Literal, atom
from agentd.mind.frames import ANNOTS, ARGS, RELEVANT
from agentd.mind.resolving import detach, resolve_all

if TYPE_CHECKING:
    from agentd.mind.mind import Mind


def raise_state(mind: Mind, relevant: Any, args: tuple[Any, ...], annots: tuple[Any, ...], state: str) -> None:
    """The event ``^!g[state(S)]`` if there is a plan for it."""
    meta = mind.plans.relevant("^", relevant.goal, relevant.sig)
    if meta.plans:
        told = Literal(signature("state", 1), (atom(state),))
        mind.post(meta, detach(resolve_all(args)), sorted_annots((*resolve_all(annots), told)))


def of_goals(mind: Mind, intention: Any, *states: str) -> None:
    """These states of all goals of an intention, innermost first, in programs with plans for them."""
    if not mind.plans.has_meta:
        return
    for frame in reversed(intention.stack):
        relevant = frame[RELEVANT]
        if relevant.operator == "+" and relevant.goal:
            for state in states:
                raise_state(mind, relevant, frame[ARGS], frame[ANNOTS], state)


def pending(mind: Mind, relevant: Any, args: tuple[Any, ...], annots: tuple[Any, ...]) -> None:
    """``^!g[state(pending)]``, in programs with plans for the states of goals."""
    raise_state(mind, relevant, args, annots, "pending")
