"""Answer a question of another agent: from beliefs and rules, or by a plan (message rules 5, 6).

For a plan, ``+?g`` runs in an intention whose end sends the answer.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.source_annotations import SELF
from agentd.language.terms.terms import Literal, Var
from agentd.mind.beliefs.belief_base import Predicate
from agentd.mind.beliefs.dynamic_formulas import solve
from agentd.mind.beliefs.term_copy import Copier, resolve
from agentd.mind.beliefs.unification import undo, unify
from agentd.mind.beliefs.work_limit import MOST_STEPS, Asked, QueryRefused, TooMuchWork
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.inputs import Mail
from agentd.mind.data.intention import Intention, Step
from agentd.mind.execution.send_message import answer_of, reply
from agentd.mind.plans.plan_library import Relevant
from agentd.mind.state import MindState

MOST_ANSWERS: Final = 10_000
"""Answers that a question solved by formulas or rules gets."""
_ANSWERING = signature("answer_question")


def answers(mind: MindState, mail: Mail, most: int = MOST_ANSWERS) -> list[Any] | None:
    """The instances of a question that hold, with the annotations of the beliefs, ``most`` of them if rules are used.

    None if the question is refused, which is told.
    """
    question = Copier(fresh=True).copy(mail.content)
    predicate = None
    if type(question) is Literal:
        predicate = mind.beliefs.known(question.sig)
        if predicate is None:
            return []
        if not predicate.rules:
            return _believed(mind, predicate, question, None)
    enough = 1 if most == 1 else most + 1  # one more tells that some are left out
    trail: list[Var] = []
    mind.asked = asked = Asked()
    mind.steps_left = MOST_STEPS
    try:
        if predicate is not None:
            found = _believed(mind, predicate, question, enough)
        else:
            found = []
            for _ in solve(mind, question, trail):
                found.append(resolve(question))
                if len(found) == enough:
                    break
        asked.check()
    except (QueryRefused, TooMuchWork) as refused:
        mind.warn_once(f"the question of {mail.sender} is refused: {refused}")
        return None
    except RecursionError:
        if predicate is not None:
            raise  # a rule of the program's own is at fault
        mind.warn_once(f"the question of {mail.sender} is refused: its computation is too deep")
        return None
    finally:
        mind.asked = None
        undo(trail, 0)
    if len(found) > most:
        mind.warn_once(f"a question of {mail.sender} has more answers than {most}: the others are left out")
    return found[:most]


def _believed(mind: MindState, predicate: Predicate, question: Literal, most: int | None) -> list[Any]:
    """What a predicate answers to a literal."""
    found: list[Any] = []
    trail: list[Var] = []
    for args, annots in predicate.literals((True,) * question.sig.arity, question.args, mind, trail):
        mark = len(trail)
        if unify(question, Literal(question.sig, args, annots), trail):
            found.append(resolve(Literal(question.sig, args, annots)))
        undo(trail, mark)
        if len(found) == most:
            break
    undo(trail, 0)
    return found


class AnsweringPlan:
    """Stands in a frame where a plan would: it asks the goal and sends what came of it."""

    special = False
    atomic = False
    condition = None
    outer = None
    subplans: tuple[Any, ...] = ()
    head = "+!answer_question"
    slots: dict[str, int] = {}  # noqa: RUF012 - no variables, ever

    def __init__(self, mail: Mail, on_failure: Callable[[MindState, Mail, Failed], None]) -> None:
        self.mail, self._on_failure = mail, on_failure
        self.syntax = nodes.Plan(nodes.Trigger("+", "!", nodes.Structure("answer_question")))

    def on_failure(self, mind: MindState, failure: Failed) -> None:
        """Say that the plan has found no answer."""
        self._on_failure(mind, self.mail, failure)


def answer_by_plan(
    mind: MindState,
    mail: Mail,
    relevant: Relevant,
    question: tuple[Literal, tuple[Any, ...]],
    on_failure: Callable[[MindState, Mail, Failed], None],
) -> None:
    """Start the intention that finds the answer to a question, a literal with annotations, and tells it."""
    literal, annots = question
    if mind.crowded:
        text = f"too many events and intentions: questions such as that of {mail.sender} get no answer"
        mind.drop("questions", text, mail.sender)
        return
    written = nodes.Step(nodes.Operator.TEST, nodes.Structure(literal.sig.functor))

    def ask(mind: MindState, intention: Intention, frame: Any) -> bool:
        mind.events.append((relevant, literal.args, annots, intention))
        return True

    def tell(mind: MindState, intention: Intention, frame: Any) -> None:
        reply(mind, mail, answer_of(mind, mail, resolve(literal)))

    plan = AnsweringPlan(mail, on_failure)
    first, second = Step(written, plan), Step(written, plan)
    first.run, first.next, second.run = ask, second, tell
    intention = mind.new_intention()
    holder = mind.plans.relevant("+", "!", _ANSWERING)
    intention.stack.append([first, plan, holder, (), SELF, 0])
    mind.running.append(intention)
