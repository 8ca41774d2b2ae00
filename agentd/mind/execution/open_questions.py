"""Synchronous asks: an intention that waits for answers, maybe of many agents."""

from __future__ import annotations

from typing import Any

from agentd.language.terms.source_annotations import is_source, told_by
from agentd.language.terms.terms import FALSE, Literal, atom, deref, make_list, proper
from agentd.mind.beliefs.annotations import nested_source
from agentd.mind.beliefs.unification import undo, unify
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.inputs import Mail
from agentd.mind.data.intention import Question
from agentd.mind.execution.execution import fail_waiting, resume_waiting
from agentd.mind.state import MindState


def wrong_answer() -> Failed:
    """The answer is not of the form that the fourth argument of ``.send`` asks for."""
    return Failed("ask_failed", "the answer does not unify with what was expected")


def _credited(answer: Any, name: str) -> Any:
    """A literal with the agent that answered as its source, unless that has named itself already."""
    if type(answer) is not Literal or answer == FALSE:
        return answer
    sources = [a.with_annots(()) for a in answer.annots if is_source(a)]
    if sources == list(told_by(name)):
        return answer
    return answer.with_annots(nested_source(answer.annots, name))


def take_answer(mind: MindState, question: Question, mail: Mail) -> None:
    """Note an answer; the intention goes on with the last one."""
    mind.questions.pop(mail.in_reply_to, None)
    question.found.append(_answer(question, mail))
    if len(question.found) == len(question.receivers):
        _finish(mind, question, make_list(question.found) if question.many else question.found[0])


def _answer(question: Question, mail: Mail) -> Any:
    """An answer as the plan gets it: literals, and those in the list that answers `askAll`, name who answered."""
    content = deref(mail.content)
    if mail.performative == "untell" and question.performative in ("askOne", "askIf"):
        return FALSE
    if type(content) is Literal:
        return _credited(content, mail.sender)
    members = proper(content) if question.performative == "askAll" else None
    return content if members is None else make_list([_credited(deref(m), mail.sender) for m in members])


def time_out(mind: MindState, question: Question) -> None:
    """Go on with the answers so far, or with ``timeout``."""
    _finish(mind, question, make_list(question.found) if question.many else atom("timeout"))


def forget_question(mind: MindState, question: Question) -> None:
    """Wait for no further answer."""
    if question.timer is not None:
        question.timer.cancelled = True
    for msg_id in question.ids:
        mind.questions.pop(msg_id, None)


def _finish(mind: MindState, question: Question, value: Any) -> None:
    forget_question(mind, question)
    trail = question.intention.trail
    mark = len(trail)
    if unify(question.answer, value, trail):
        resume_waiting(mind, question.intention)
    else:
        undo(trail, mark)
        fail_waiting(mind, question.intention, wrong_answer())
