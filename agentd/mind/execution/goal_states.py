"""The states of goals: events ``^!g[state(S)]``, for programs with plans for them, and why an intention waits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.from_ast import instantiate
from agentd.language.terms.order import sorted_annots
from agentd.language.terms.terms import Literal, Term, atom
from agentd.mind.beliefs.term_copy import detach, resolve, resolve_all
from agentd.mind.data.intention import ANNOTS, ARGS, RELEVANT, Frame, Intention, values_of, wait_text
from agentd.mind.plans.plan_library import Relevant
from agentd.mind.state import MindState
from schemas.wire.mind_records import WaitView

if TYPE_CHECKING:
    from agentd.mind.data.formula_failure import Failed

_STATE, _REASON, _WAIT = signature("state", 1), signature("reason", 1), signature("wait", 1)


def raise_state(
    mind: MindState,
    relevant: Relevant,
    args: tuple[Term, ...],
    annots: tuple[Term, ...],
    state: str,
    reason: Term | None = None,
) -> None:
    """Raise the event ``^!g[state(S)]``, or ``^!g[state(S)[reason(R)]]``, if there is a plan for it."""
    meta = mind.plans.relevant("^", relevant.goal, relevant.sig)
    if meta.plans:
        because = () if reason is None else (Literal(_REASON, (reason,)),)
        annot = Literal(_STATE, (atom(state),), because)
        mind.post(meta, detach(resolve_all(args)), sorted_annots((*resolve_all(annots), annot)))


def of_goals(mind: MindState, intention: Intention, state: str, reason: Term | None = None) -> None:
    """Report this state of all goals of an intention, innermost first, in programs with plans for them.

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


def pending(mind: MindState, relevant: Relevant, args: tuple[Term, ...], annots: tuple[Term, ...]) -> None:
    """``^!g[state(pending)]``, in programs with plans for the states of goals."""
    raise_state(mind, relevant, args, annots, "pending")


def begun(mind: MindState, frame: Frame) -> None:
    """Report that the first plan of a goal begins."""
    if frame[RELEVANT].goal and frame[RELEVANT].operator == "+":
        raise_state(mind, frame[RELEVANT], frame[ARGS], frame[ANNOTS], "executing")


def ended(mind: MindState, relevant: Relevant, args: tuple[Term, ...], annots: tuple[Term, ...]) -> None:
    """Report that a goal is achieved, by a plan for it or by its failure plan."""
    if mind.plans.has_meta and relevant.goal and relevant.operator != "^":
        raise_state(mind, relevant, args, annots, "achieved")
        raise_state(mind, relevant, args, annots, "finished", atom("achieved"))


def dropped(mind: MindState, intention: Intention) -> None:
    """Report that the goals of an intention are dropped."""
    of_goals(mind, intention, "dropped")
    of_goals(mind, intention, "finished", atom("dropped"))


def failed(mind: MindState, intention: Intention | None, failure: Failed, handled: bool) -> None:
    """Raise the states of a failed goal: the one that found no plan, else the innermost; ``handled`` by a failure plan.

    Goals below it have not failed by that, as in Jason. The failure of a branch's own formula is that of the goal
    around the fork, which is raised when the parent fails.
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


def reason_of(intention: Intention) -> Literal | None:
    """Return why an intention does not run, for ``.suspended``; None for one that does.

    ``suspend_ia``, ``wait(What)`` as it was asked for, ``waiting_ask``, ``act`` (an action), ``fork``, ``team`` (a
    request such as ``.create_agent``), ``goal_condition``, or the reason given by an internal action in Python.
    """
    awaited = intention.waiting
    if awaited is None:
        return atom("suspend_ia") if intention.suspended is not None else None
    match awaited.kind:
        case "action":
            return atom("act")
        case "time" | "formula" | "event":
            return Literal(_WAIT, (_waited_for(intention, awaited),))
        case "answer":
            return atom("waiting_ask")
        case "python":
            return atom(awaited.name)
    return atom(awaited.kind)


def _waited_for(intention: Intention, awaited: WaitView) -> Any:
    """Return the first argument of the ``.wait`` that an intention is in."""
    step = None if intention.last is None else intention.last.syntax
    if isinstance(step, nodes.Step) and isinstance(step.term, nodes.InternalAction):
        return resolve(instantiate(step.term.args[0], values_of(intention.stack[-1])))
    return wait_text(awaited)
