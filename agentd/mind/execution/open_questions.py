"""Synchronous asks: an intention that waits for answers, maybe of many agents."""

from __future__ import annotations

from typing import Any

from agentd.language.terms.source_annotations import is_source, told_by
from agentd.language.terms.terms import FALSE, Literal, atom, deref, make_list, proper
from agentd.mind.beliefs.annotations import nested_source
from agentd.mind.beliefs.unification import undo, unify
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.inputs import Mail
from agentd.mind.data.intention import Intention
from agentd.mind.execution.waiting import fail_waiting, resume_waiting


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


class Question:
    """A synchronous ask: the intention that waits, and for whose answers."""

    def __init__(self, intention: Intention, answer: Any, many: bool, receivers: list[str]) -> None:
        self.intention, self.answer, self.many, self.wanted = intention, answer, many, len(receivers)
        self.receivers = receivers
        self.performative, self.content, self.asked = "", None, 0.0
        """What is asked, as a term, and since when in mission seconds."""
        self.ids: list[str] = []
        """Of the messages, in the order of the receivers."""
        self.found: list[Any] = []
        self.timer: Any = None

    def answered(self, mind: Any, mail: Mail) -> None:
        """One answer has come."""
        mind.questions.pop(mail.in_reply_to, None)
        self.found.append(self._answer(mail))
        if len(self.found) < self.wanted:
            return
        self.finish(mind, make_list(self.found) if self.many else self.found[0])

    def _answer(self, mail: Mail) -> Any:
        """An answer as the plan gets it: literals, and those in the list that answers `askAll`, name who answered."""
        content = deref(mail.content)
        if mail.performative == "untell" and self.performative in ("askOne", "askIf"):
            return FALSE
        if type(content) is Literal:
            return _credited(content, mail.sender)
        members = proper(content) if self.performative == "askAll" else None
        return content if members is None else make_list([_credited(deref(m), mail.sender) for m in members])

    def timed_out(self, mind: Any) -> None:
        self.finish(mind, make_list(self.found) if self.many else atom("timeout"))

    def forget(self, mind: Any) -> None:
        """No answer is waited for any more."""
        if self.timer is not None:
            self.timer.cancelled = True
        for msg_id in self.ids:
            mind.questions.pop(msg_id, None)

    def finish(self, mind: Any, value: Any) -> None:
        self.forget(mind)
        trail = self.intention.trail
        mark = len(trail)
        if unify(self.answer, value, trail):
            resume_waiting(mind, self.intention)
        else:
            undo(trail, mark)
            fail_waiting(mind, self.intention, wrong_answer())
