"""Events about the states of goals, ``^!g[state(S)]``, for programs that have plans for them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.order import sorted_annots
from agentd.language.terms.terms import Literal, atom
from agentd.mind.beliefs.term_copy import detach, resolve_all
from agentd.mind.data.frames import ANNOTS, ARGS, RELEVANT, Frame

if TYPE_CHECKING:
    from agentd.mind.data.formula_failure import Failed
    from agentd.mind.data.intention import Intention
    from agentd.mind.mind import Mind

_STATE, _REASON = signature("state", 1), signature("reason", 1)


def raise_state(
    mind: Mind, relevant: Any, args: tuple[Any, ...], annots: tuple[Any, ...], state: str, reason: Any = None
) -> None:
    """The event ``^!g[state(S)]`` if there is a plan for it, with ``state(S)[reason(R)]`` where there is a reason."""
    meta = mind.plans.relevant("^", relevant.goal, relevant.sig)
    if meta.plans:
        because = () if reason is None else (Literal(_REASON, (reason,)),)
        told = Literal(_STATE, (atom(state),), because)
        mind.post(meta, detach(resolve_all(args)), sorted_annots((*resolve_all(annots), told)))


def of_goals(mind: Mind, intention: Intention, state: str, reason: Any = None) -> None:
    """This state of all goals of an intention, innermost first, in programs with plans for them.

    The goal around a fork is its parent's and not its branches'.
    """
    if not mind.plans.has_meta:
        return
    frames = intention.stack if intention.branch is None else intention.stack[1:]
    goals = [(frame[RELEVANT], frame[ARGS], frame[ANNOTS]) for frame in reversed(frames)]
    if intention.held is not None:
        goals.insert(0, intention.held[:3])
    for relevant, args, annots in goals:
        if relevant.operator == "+" and relevant.goal:
            raise_state(mind, relevant, args, annots, state, reason)


def pending(mind: Mind, relevant: Any, args: tuple[Any, ...], annots: tuple[Any, ...]) -> None:
    """``^!g[state(pending)]``, in programs with plans for the states of goals."""
    raise_state(mind, relevant, args, annots, "pending")


def begun(mind: Mind, frame: Frame) -> None:
    """The first plan of a goal begins."""
    if frame[RELEVANT].goal and frame[RELEVANT].operator == "+":
        raise_state(mind, frame[RELEVANT], frame[ARGS], frame[ANNOTS], "executing")


def ended(mind: Mind, relevant: Any, args: tuple[Any, ...], annots: tuple[Any, ...]) -> None:
    """A goal is achieved, by a plan for it or by its failure plan."""
    if mind.plans.has_meta and relevant.goal and relevant.operator != "^":
        raise_state(mind, relevant, args, annots, "achieved")
        raise_state(mind, relevant, args, annots, "finished", atom("achieved"))


def dropped(mind: Mind, intention: Intention) -> None:
    """The goals of an intention are dropped."""
    of_goals(mind, intention, "dropped")
    of_goals(mind, intention, "finished", atom("dropped"))


def failed(mind: Mind, intention: Intention | None, failure: Failed, handled: bool) -> None:
    """The goal that found no plan, or else the innermost one, has failed; ``handled``: a failure plan is to begin.

    Goals below it have not failed by that, as in Jason. The failure of a branch's own formula is that of the goal
    around the fork, told where the parent fails.
    """
    if failure.goal is not None:
        relevant, args, annots = failure.goal, failure.code.args, failure.code.annots
    elif intention is not None and (len(intention.stack) > 1 or (intention.stack and intention.branch is None)):
        frame = intention.stack[-1]
        relevant, args, annots = frame[RELEVANT], frame[ARGS], frame[ANNOTS]
    else:
        return
    if relevant.operator == "+" and relevant.goal:
        raise_state(mind, relevant, args, annots, "failed")
        if handled:
            raise_state(mind, relevant, args, annots, "executing")
