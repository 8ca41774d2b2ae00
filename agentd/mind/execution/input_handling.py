"""Taking in what has come from outside: percepts, results of actions, answers, goals and beliefs."""

from __future__ import annotations

from typing import Any, Final

from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.terms import Literal, atom
from agentd.mind.beliefs.annotations import with_source
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.inputs import (
    ActionDone,
    BeliefAdded,
    GoalAdded,
    PerceptAdded,
    PerceptRemoved,
    PerceptReplaced,
    PerceptsChanged,
    SignalRaised,
    TeamReply,
)
from agentd.mind.execution import percept_update
from agentd.mind.execution.belief_updates import add_belief
from agentd.mind.execution.execution import fail_waiting, resume_waiting
from agentd.mind.execution.goal_execution import add_goal
from agentd.mind.execution.team_requests import take_reply
from agentd.mind.state import MindState


def take_inputs(mind: MindState) -> bool:
    """All percepts and results that have come in: deletions of percepts before additions.

    Returns whether there were percepts only.
    """
    batch: list[Any] = list(mind.inputs)
    mind.inputs.clear()
    added: list[Any] = []
    percepts_only = True
    for item in batch:
        if mind.on_input is not None:
            mind.on_input(mind.cycle, item)
        kind = type(item)
        if kind in _PERCEPT:
            percept_update.update(mind, item, added)
        elif kind is PerceptsChanged:
            percept_update.change(mind, item, added)
        else:
            percepts_only = False
            _take(mind, item)
    if added:
        percept_update.raise_additions(mind, added)
    return percepts_only


_PERCEPT: Final = frozenset((PerceptReplaced, PerceptAdded, PerceptRemoved))


def _take(mind: MindState, item: Any) -> None:
    """Take an input that is no percept."""
    if mind.recorder is not None:
        mind.recorder.given(mind.cycle, item)
    match item:
        case ActionDone():
            _action_done(mind, item)
        case TeamReply():
            take_reply(mind, item)
        case GoalAdded(literal=literal):
            add_goal(mind, literal)
        case BeliefAdded(literal=literal):
            add_belief(mind, literal)
        case SignalRaised(literal=literal):
            mind.post(mind.plans.relevant("+", "", literal.sig), literal.args, with_source(literal.annots))
        case _:
            pass


def _action_done(mind: MindState, done: ActionDone) -> None:
    intention = mind.action_client.pop(done.id, None)
    if intention is None or intention.action != done.id:
        return
    if done.ok:
        resume_waiting(mind, intention)
        return
    facts = [Literal(signature("reason", 1), (done.reason,))] if done.reason else []
    if done.state:
        facts.append(Literal(signature("state", 1), (atom(done.state),)))
    if done.cause:
        facts.append(Literal(signature("cause", 1), (atom(done.cause),)))
    fail_waiting(mind, intention, Failed("action_failed", done.reason, tuple(facts)))
