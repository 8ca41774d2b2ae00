"""Sending messages."""

from __future__ import annotations

from typing import Any

from agentd.language.terms.terms import EMPTY, List, Literal, Term, Var, atom, deref, make_list, proper
from agentd.mind.beliefs.term_copy import detached
from agentd.mind.beliefs.unification import Trail, unify
from agentd.mind.data.formula_failure import Failed, wrong_arguments
from agentd.mind.data.intention import Question
from agentd.mind.data.registry import internal_action
from agentd.mind.execution.execution import await_something
from agentd.mind.execution.messages import send
from agentd.mind.execution.waiting import forget_question, milliseconds, time_out, wrong_answer
from agentd.mind.state import MindState
from schemas.wire.mind_records import WaitView

_ASKS = ("askOne", "askAll", "askHow", "askIf")


def name_of(term: Term) -> str:
    """An agent's name given as atom or string. Fails with ``wrong_arguments`` for anything else."""
    if type(term) is Var:
        term = deref(term)
    if type(term) is str:
        return term
    if type(term) is Literal and not term.args:
        return term.sig.functor
    return wrong_arguments("the name of an agent is an atom or a string")


def _present(mind: MindState, name: str) -> str:
    """The name of a receiver; ``self`` is the sender. Fails if there is no such agent."""
    if name == "self":
        return str(mind.name)
    if mind.agents is not None and name not in mind.agents():
        raise Failed("receiver_not_found", f"there is no agent '{name}' to send to")
    return name


def _receivers(to: Term) -> list[str]:
    return [name_of(member) for member in proper(to) or []] if type(to) is List else [name_of(to)]


@internal_action(".send", 3, suspends=True, names=2)
def send_message(mind: MindState, trail: Trail, to: Term, performative: Term, content: Term) -> None:
    """``.send(To, Performative, Content)``: a message to an agent, or to each of a list of them.

    Fails with ``receiver_not_found``, or if a mailbox is full; later failures raise ``+undelivered``.
    """
    if type(performative) is not str:
        performative = name_of(performative)
    if type(content) is not Literal or not content.ground:
        content = detached(content)
    for receiver in (to,) if type(to) is str else _receivers(deref(to)):
        send(mind, _present(mind, receiver), performative, content)


@internal_action(".send", (4, 5), suspends=True)
def send_and_wait(
    mind: MindState, trail: Trail, to: Term, performative: Term, content: Term, answer: Term, limit: Term | None = None
) -> bool | None:
    """``.send(To, Performative, Content, Answer[, TimeoutMs])``: the intention waits for the answer to a question
    (``askOne``, ``askAll``, ``askIf``, ``askHow``); to a list of agents, for the list of their answers.
    """
    to = deref(to)
    force, content = name_of(performative), detached(content)
    if force in _ASKS:
        asked = [mind.name if name == "self" else name for name in _receivers(to)]
        return _ask(mind, asked, type(to) is List, force, content, (answer, limit))
    reply_to = deref(answer)
    for receiver in _receivers(to):
        send(mind, _present(mind, receiver), force, content, reply_to if type(reply_to) is str else "")
    return None


def _ask(
    mind: MindState, receivers: list[str], many: bool, force: str, content: Term, rest: tuple[Any, Any]
) -> bool | None:
    answer, limit = rest
    seconds = mind.ask_timeout if limit is None else milliseconds(limit)
    if not receivers:
        if not unify(answer, EMPTY, mind.own_intention.trail):
            raise wrong_answer()
        return None
    intention = mind.own_intention
    question = Question(intention, answer, many, receivers, force, content, mind.now)
    await_something(mind, intention, WaitView(kind="answer", agents=tuple(receivers)), question)
    for receiver in receivers:
        try:
            msg_id = send(mind, _present(mind, receiver), force, content, kind="sync")
        except Failed:
            forget_question(mind, question)
            mind.waiting.pop(intention.id, None)
            intention.waiting = None
            raise
        question.ids.append(msg_id)
        mind.questions[msg_id] = question
    if seconds is not None:
        question.timer = mind.timers.at(mind.now + seconds, lambda: time_out(mind, question))
    return True


@internal_action(".broadcast", 2)
def broadcast(mind: MindState, trail: Trail, performative: Term, content: Term) -> bool:
    """``.broadcast(Performative, Content)``: a message to all others."""
    send(mind, None, name_of(performative), detached(content))
    return True


@internal_action(".all_names", 1, pure=True)
def all_names(mind: MindState, trail: Trail, result: Term) -> bool:
    """``.all_names(L)``: the names of all possible receivers, including the agent itself."""
    names = [mind.name] if mind.agents is None else list(mind.agents())
    return unify(result, make_list([atom(n) for n in names]), trail)
