"""Messages between agents: sending, answering questions, and what each performative does (message rules 1 to 19).

A question is answered from beliefs and rules, or by a plan: then ``+?g`` runs in an intention whose end sends the
answer (message rules 5, 6).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Final

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.format import text
from agentd.language.terms.source_annotations import SELF, SOURCE_SELF, told_by
from agentd.language.terms.terms import FALSE, Literal, Term, Var, atom, deref, make_list, proper
from agentd.mind.beliefs.belief_base import Predicate
from agentd.mind.beliefs.dynamic_formulas import solve
from agentd.mind.beliefs.term_copy import Copier, detach, detached, nested_source, resolve, resolve_all
from agentd.mind.beliefs.unification import undo, unify
from agentd.mind.beliefs.work_limit import MOST_STEPS, Asked, QueryRefused, TooMuchWork
from agentd.mind.data.effects import Log
from agentd.mind.data.formula_failure import Failed, argument, as_failed, wrong_arguments
from agentd.mind.data.inputs import Mail
from agentd.mind.data.intention import Frame, Intention, Step
from agentd.mind.execution.belief_updates import believe, disbelieve
from agentd.mind.execution.dropping import drop_desire
from agentd.mind.execution.execution import communication_error, resume_waiting
from agentd.mind.execution.goal_states import raise_state
from agentd.mind.execution.waiting import signal, take_answer
from agentd.mind.introspection.failure_text import error_annots
from agentd.mind.plans.plan_library import Relevant
from agentd.mind.plans.plan_terms import add_plans, relevant_plans, remove_plans
from agentd.mind.state import MindState

# --- sending ---


def send(
    mind: MindState, receiver: str | None, performative: str, content: Term, in_reply_to: str = "", kind: str = "mid"
) -> str:
    """Hand a message out; returns its id, which begins with ``kind``: ``sync`` if the sender waits for an answer.

    Fails with ``message_too_large``, ``mailbox_full`` or ``not_sendable`` if the mind's post office does not take it.
    """
    mind.message_count += 1
    msg_id = f"{kind}{mind.message_count}.{mind.name}"
    mail = Mail(mind.name, performative, content, msg_id, in_reply_to, receiver)
    if mind.post_office is None:
        mind.effects.append(mail)
    else:
        mind.post_office(mail)
    return msg_id


def reply(mind: MindState, mail: Mail, content: Term) -> None:
    """Answer a question: a synchronous one by a message in reply, another one by ``tell``.

    An answer that cannot be sent is logged; the waiting agent's ask times out.
    """
    if not mail.msg_id.startswith("sync") and content is FALSE:
        return
    try:
        send(mind, mail.sender, "tell", content, mail.msg_id)
    except Failed as failed:
        mind.effects.append(Log("warning", f"the question of {mail.sender} gets no answer: {failed}"))


def answer_of(mind: MindState, mail: Mail, found: Term) -> Any:
    """Return the answer to a question: a synchronous one names its source; else the receiver adds it."""
    answer = detached(found)
    if type(answer) is not Literal:
        return answer
    if mail.msg_id.startswith("sync"):
        return answer.with_annots(nested_source(answer.annots, mind.name))
    return answer.with_annots(tuple(a for a in answer.annots if a != SOURCE_SELF))


# --- answers ---


QUESTIONS: Final = frozenset({"askOne", "askIf", "askAll"})
"""Performatives whose content is copied before it is solved: the message itself stays as it is."""
MOST_ANSWERS: Final = 10_000
"""Answers that a question solved by formulas or rules gets."""
_ANSWERING = signature("answer_question")


def answers(mind: MindState, mail: Mail, most: int = MOST_ANSWERS) -> list[Term] | None:
    """Return the true instances of a question, annotated as the beliefs, ``most`` of them if rules are used.

    None if the question is refused, which is logged.
    """
    question = Copier(fresh=True).copy(mail.content)
    predicate = None
    if type(question) is Literal:
        predicate = mind.beliefs.known(question.sig)
        if predicate is None:
            return []
        if not predicate.rules:
            return _believed(mind, predicate, question, None)
    enough = 1 if most == 1 else most + 1  # one more shows that some are left out
    trail: list[Var] = []
    mind.asked = asked = Asked()
    mind.steps_left = MOST_STEPS
    try:
        if predicate is not None:
            found = _believed(mind, predicate, question, enough)
        else:
            found = []
            for _ in solve(mind, question, trail):
                asked.copies(question)
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


def _believed(mind: MindState, predicate: Predicate, question: Literal, most: int | None) -> list[Term]:
    """Return the answers of a predicate to a literal."""
    found: list[Term] = []
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
    """Takes the place of a plan in a frame: asks the goal and sends the result."""

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
    question: tuple[Literal, tuple[Term, ...]],
    on_failure: Callable[[MindState, Mail, Failed], None],
) -> None:
    """Start the intention that finds and sends the answer to a question, a literal with annotations."""
    literal, annots = question
    if mind.crowded:
        text = f"too many events and intentions: questions such as that of {mail.sender} get no answer"
        mind.drop("questions", text, mail.sender)
        return
    written = nodes.Step(nodes.Operator.TEST, nodes.Structure(literal.sig.functor))

    def ask(mind: MindState, intention: Intention, frame: Frame) -> bool:
        mind.events.append((relevant, literal.args, annots, intention))
        return True

    def tell(mind: MindState, intention: Intention, frame: Frame) -> None:
        reply(mind, mail, answer_of(mind, mail, resolve(literal)))

    plan = AnsweringPlan(mail, on_failure)
    first, second = Step(written, plan), Step(written, plan)
    first.run, first.next, second.run = ask, second, tell
    intention = mind.new_intention()
    holder = mind.plans.relevant("+", "!", _ANSWERING)
    intention.stack.append([first, plan, holder, (), SELF, 0])
    mind.running.append(intention)


# --- receiving ---


def receive(mind: MindState, mail: Mail) -> None:
    """Handle one message, or post its event ``+!kqml_received``.

    The event is posted if the program has plans for it, or while an atomic plan runs. Even then ``tell`` and
    ``achieve`` of a literal act on arrival, as in Jason; other messages have their effects after the atomic plan.
    """
    if mail.in_reply_to and is_answer(mail.in_reply_to):
        question = mind.questions.get(mail.in_reply_to)
        if question is not None and mail.sender in question.receivers:
            take_answer(mind, question, mail)
        return  # otherwise the ask has ended, or its sender was not asked
    custom = mind.plans.kqml
    if custom.plans or (
        mind.atomic is not None and not (mail.performative in ("tell", "achieve") and type(mail.content) is Literal)
    ):
        args = (atom(mail.sender), atom(mail.performative), mail.content, mail.msg_id)
        mind.post(custom, detach(args), ())
        return
    _handle(mind, mail)


def is_answer(in_reply_to: str) -> bool:
    """Return whether a message answers a synchronous ask: it resumes the waiting intention and has no other effect."""
    return in_reply_to.startswith("sync")


def _handle(mind: MindState, mail: Mail) -> None:
    """Do what a message asks for, as the built-in plans for ``+!kqml_received``."""
    mind.steps_left = MOST_STEPS
    try:
        _HANDLERS.get(mail.performative, _nobody_handles)(mind, mail)
    except Exception as error:  # a function of the program's may raise anything; it must not end the mind
        _not_handled(mind, mail, as_failed(error))


def _nobody_handles(mind: MindState, mail: Mail) -> None:
    raise Failed("no_applicable", f"nobody handles the performative {mail.performative}")


def handle_event(mind: MindState, args: tuple[Term, ...], intention: Intention | None) -> None:
    """``+!kqml_received(Sender, Performative, Content, Id)`` that no plan of the program is applicable to."""
    _handle(mind, _mail_of(args))
    if intention is not None:
        resume_waiting(mind, intention)


def _mail_of(args: tuple[Term, ...]) -> Mail:
    sender, performative, content, msg_id = (deref(resolve(a)) for a in args)
    return Mail(plain(sender), plain(performative), content, plain(msg_id))


def plain(term: Term) -> str:
    """Return a name or id as the plans for messages get it: an atom or a string."""
    return term if type(term) is str else text(term)


def _not_handled(mind: MindState, mail: Mail, failed: Failed) -> None:
    """Raise ``-!kqml_received`` for a message that cannot be handled; without a plan for it, print the error."""
    event = Literal(mind.plans.kqml.sig, (atom(mail.sender), atom(mail.performative), mail.content, mail.msg_id))
    handler = mind.plans.kqml.counterpart("-")
    if handler.plans:
        mind.post(handler, detach(event.args), error_annots(failed, event, 0, ""))
        return
    what = str(failed)
    if failed.error == "no_applicable":
        what = f"Found a goal for which there is no applicable plan: +!{text(event)} ({what})"
    communication_error(mind, failed.error, what)


def told_annots(mind: MindState, literal: Literal, sender: str) -> tuple[Term, ...]:
    """Return the annotations of a literal in a message of ``sender``: former sources are nested inside the new one."""
    if sender == mind.name:
        sender = "self"
    elif not literal.annots:
        return told_by(sender)
    return nested_source(literal.annots, sender)


def _each(content: Term) -> Iterable[Any]:
    if type(content) is Literal:
        return (content,)
    members = proper(content)
    return map(deref, [content] if members is None else members)


def _tell(mind: MindState, mail: Mail) -> None:
    for content in _each(mail.content):
        if type(content) is Literal:
            args = content.args if content.ground else detach(resolve_all(content.args))
            predicate = mind.beliefs.predicate(content.sig)
            relevant = mind.plans.relevant("+", "", content.sig)
            believe(mind, None, predicate, relevant, args, told_annots(mind, content, mail.sender))
        elif content is mail.content:
            raise Failed("no_applicable", "only literals can be sent with tell")


def _untell(mind: MindState, mail: Mail) -> None:
    content = argument(Literal, mail.content, "only a literal can be untold", "no_applicable")
    predicate = mind.beliefs.predicate(content.sig)
    relevant = mind.plans.relevant("-", "", content.sig)
    trail: list[Var] = []
    disbelieve(mind, None, predicate, relevant, content.args, told_annots(mind, content, mail.sender), trail)


def _achieve(mind: MindState, mail: Mail) -> None:
    for goal in _each(mail.content):
        if type(goal) is Literal:
            relevant = mind.plans.relevant("+", "!", goal.sig)
            annots = told_annots(mind, goal, mail.sender)
            if mind.plans.has_meta:
                raise_state(mind, relevant, goal.args, annots, "pending")
            mind.post(relevant, goal.args if goal.ground else detach(goal.args), annots)
        elif goal is mail.content:
            raise Failed("body_var_not_literal", f"{text(goal)} is no goal to achieve")


def _unachieve(mind: MindState, mail: Mail) -> None:
    content = deref(mail.content)
    if type(content) is not Literal:
        wrong_arguments(f"{text(content)} is no goal to drop")
    drop_desire(mind, content, [])


def _signal(mind: MindState, mail: Mail) -> None:
    content = deref(mail.content)
    if type(content) is not Literal:
        raise Failed("unknown", f"{text(content)} is no event to signal")
    annots = told_annots(mind, content, mail.sender)
    relevant = mind.plans.relevant("+", "", content.sig)
    signal(mind, relevant, content.args, annots)


def _ask_one(mind: MindState, mail: Mail) -> None:
    found = answers(mind, mail, 1)
    if found is None:
        reply(mind, mail, FALSE)
        return
    if found:
        reply(mind, mail, answer_of(mind, mail, found[0]))
        return
    question = Copier(fresh=True).copy(mail.content)
    if type(question) is Literal:
        relevant = mind.plans.relevant("+", "?", question.sig)
        if relevant.plans:
            asked = question, told_annots(mind, question, mail.sender)
            answer_by_plan(mind, mail, relevant, asked, unanswered)
            return
    unanswered(mind, mail, Failed("test_goal_failed", f"Failed to test '{text(mail.content)}'"))


def unanswered(mind: MindState, mail: Mail, failed: Failed) -> None:
    """Handle a question without an answer: ask the program's own ``-!kqml_received``, else see `not_answered`."""
    if mind.plans.kqml.counterpart("-").plans:
        _not_handled(mind, mail, failed)
    else:
        not_answered(mind, mail, failed.error, str(failed))


def not_answered(mind: MindState, mail: Mail, error: str, message: str) -> None:
    """Answer false when the test has failed; another failure gives none, as Jason."""
    if error == "test_goal_failed":
        reply(mind, mail, FALSE)
    else:
        mind.effects.append(Log("warning", f"the question of {mail.sender} gets no answer: {message}"))


def failed_event(mind: MindState, args: tuple[Term, ...], error: str, message: str) -> None:
    """``-!kqml_received(Sender, Performative, Content, Id)`` that no plan of the program is applicable to."""
    mail = _mail_of(args)
    if mail.performative in ("askOne", "askIf"):
        not_answered(mind, mail, error, message)
    else:
        communication_error(mind, error, message)


def _ask_all(mind: MindState, mail: Mail) -> None:
    found = [answer_of(mind, mail, a) for a in answers(mind, mail) or ()]
    if mail.msg_id.startswith("sync") or found:
        reply(mind, mail, make_list(found))


def _ask_how(mind: MindState, mail: Mail) -> None:
    found = relevant_plans(mind, mail.content, told_by=atom(mind.name))
    if mail.msg_id.startswith("sync"):
        send(mind, mail.sender, "tell", make_list(found), mail.msg_id)
    elif found:
        send(mind, mail.sender, "tellHow", make_list(found), mail.msg_id)


_HANDLERS: Final[dict[str, Callable[[MindState, Mail], None]]] = {
    "tell": _tell,
    "untell": _untell,
    "achieve": _achieve,
    "unachieve": _unachieve,
    "signal": _signal,
    "askOne": _ask_one,
    "askIf": _ask_one,
    "askAll": _ask_all,
    "askHow": _ask_how,
    "tellHow": lambda mind, mail: add_plans(mind, mail.content, atom(mail.sender), first=False),
    "untellHow": lambda mind, mail: remove_plans(mind, mail.content, atom(mail.sender)),
}
