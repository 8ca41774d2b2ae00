"""Answering a question by a plan: ``+?g`` runs in an intention whose end tells the answer (message rules 5, 6)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.source_annotations import SELF
from agentd.language.terms.terms import Literal
from agentd.mind.beliefs.term_copy import resolve
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.frames import Step
from agentd.mind.data.inputs import Mail
from agentd.mind.execution.send_message import answer_of, reply

_ANSWERING = signature("answer_question")


class AnsweringPlan:
    """Stands in a frame where a plan would: it asks the goal and sends what came of it."""

    special = False
    atomic = False
    condition = None
    outer = None
    subplans: tuple[Any, ...] = ()
    head = "+!answer_question"
    slots: dict[str, int] = {}  # noqa: RUF012 - no variables, ever

    def __init__(self, mail: Mail, on_failure: Callable[[Any, Mail, Failed], None]) -> None:
        self.mail, self._on_failure = mail, on_failure
        self.syntax = nodes.Plan(nodes.Trigger("+", "!", nodes.Structure("answer_question")))

    def on_failure(self, mind: Any, failure: Failed) -> None:
        """Say that the plan has found no answer."""
        self._on_failure(mind, self.mail, failure)


def answer_by_plan(
    mind: Any,
    mail: Mail,
    relevant: Any,
    question: tuple[Literal, tuple[Any, ...]],
    on_failure: Callable[[Any, Mail, Failed], None],
) -> None:
    """Start the intention that finds the answer to a question, a literal with annotations, and tells it."""
    literal, annots = question
    if mind.crowded:
        told = f"too many events and intentions: questions such as that of {mail.sender} get no answer"
        mind.drops.note("questions", told, mail.sender)
        return
    written = nodes.Step(nodes.Operator.TEST, nodes.Structure(literal.sig.functor))

    def ask(mind: Any, intention: Any, frame: Any) -> bool:
        mind.events.append((relevant, literal.args, annots, intention))
        return True

    def tell(mind: Any, intention: Any, frame: Any) -> None:
        reply(mind, mail, answer_of(mind, mail, resolve(literal)))

    plan = AnsweringPlan(mail, on_failure)
    first, second = Step(written, plan), Step(written, plan)
    first.run, first.next, second.run = ask, second, tell
    intention = mind.new_intention()
    holder = mind.plans.relevant("+", "!", _ANSWERING)
    intention.stack.append([first, plan, holder, (), SELF, 0])
    mind.running.append(intention)
