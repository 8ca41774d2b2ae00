"""Synchronous asks: an intention that waits for answers, maybe of many agents."""

from __future__ import annotations

from typing import Any

from agentd.language.terms import atom, make_list
from agentd.mind.failed import Failed
from agentd.mind.inputs import Mail
from agentd.mind.intentions import Intention
from agentd.mind.unifier import undo, unify
from agentd.mind.waiting import fail_waiting, resume_waiting


def wrong_answer() -> Failed:
    """The answer is not of the form that the fourth argument of ``.send`` asks for."""
    return Failed("ask_failed", "the answer does not unify with what was expected")


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
        self.found.append(mail.content)
        if len(self.found) < self.wanted:
            return
        self.finish(mind, make_list(self.found) if self.many else self.found[0])

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
