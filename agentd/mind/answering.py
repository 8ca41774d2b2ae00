"""Answering a question by a plan: ``+?g`` runs in an intention whose end tells the answer (message rules 5, 6)."""

from __future__ import annotations

from typing import Any

from agentd.language import syntax
from agentd.language.terms import SELF, Literal, signature
from agentd.mind.frames import Step
from agentd.mind.inputs import Mail
from agentd.mind.unifier import resolve

_ANSWERING = signature("answer_question")


class _AnsweringPlan:
    """Stands in a frame where a plan would: it asks the goal and sends what came of it."""

    special = False
    atomic = False
    condition = None
    outer = None
    subplans: tuple[Any, ...] = ()
    head = "+!answer_question"
    slots: dict[str, int] = {}  # noqa: RUF012 - no variables, ever

    def __init__(self) -> None:
        self.syntax = syntax.Plan(syntax.Trigger("+", "!", syntax.Structure("answer_question")))


_PLAN = _AnsweringPlan()


def answer_by_plan(mind: Any, mail: Mail, relevant: Any, question: Literal, annots: tuple[Any, ...]) -> None:
    """Start the intention that finds the answer to a question and tells it."""
    from agentd.mind.messages import reply

    written = syntax.Step(syntax.Operator.TEST, syntax.Structure(question.sig.functor))

    def ask(mind: Any, intention: Any, frame: Any) -> bool:
        mind.events.append((relevant, question.args, annots, intention))
        return True

    def tell(mind: Any, intention: Any, frame: Any) -> None:
        from agentd.mind.messages import _answer_text

        reply(mind, mail, _answer_text(mind, resolve(question)))

    first, second = Step(written, _PLAN), Step(written, _PLAN)
    first.run, first.next, second.run = ask, second, tell
    intention = mind.new_intention()
    holder = mind.plans.relevant("+", "!", _ANSWERING)
    intention.stack.append([first, _PLAN, holder, (), SELF, 0])
    mind.running.append(intention)
