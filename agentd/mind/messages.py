"""Messages between agents: what each performative does to the mind that gets it (rules 1 to 19 of messages)."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, Final

from agentd.language.order import sorted_annots
from agentd.language.sources import SELF, SOURCE_SELF, is_source, source, told_by
from agentd.language.term_text import text
from agentd.language.terms import FALSE, Literal, Var, atom, deref, make_list, proper
from agentd.mind.answering import answer_by_plan
from agentd.mind.asked import answers
from agentd.mind.changes import believe, disbelieve
from agentd.mind.communication import communication_error
from agentd.mind.dropping import drop_desire
from agentd.mind.failed import Failed, as_failed, wrong_arguments
from agentd.mind.failure_facts import error_annots
from agentd.mind.goal_states import raise_state
from agentd.mind.inputs import Mail
from agentd.mind.plan_terms import add_plans, relevant_plans, remove_plans
from agentd.mind.resolving import Copier, detach, resolve, resolve_all
from agentd.mind.sending import answer_text, reply, send
from agentd.mind.waiting import hear, resume_waiting

if TYPE_CHECKING:
    from agentd.mind.mind import Mind


def receive(mind: Mind, mail: Mail) -> None:
    """Handle one message."""
    if mail.in_reply_to:
        question = mind.questions.get(mail.in_reply_to)
        if question is not None:
            question.answered(mind, mail)
            return
        if mail.in_reply_to.startswith("sync"):
            return  # the answer to a question that nobody waits for any more
    custom = mind.plans.kqml
    if custom.plans:
        args = (atom(mail.sender), atom(mail.performative), mail.content, mail.msg_id)
        mind.post(custom, detach(args), ())
        return
    try:
        _HANDLERS.get(mail.performative, _nobody_handles)(mind, mail)
    except Exception as error:  # a function of the program's may raise anything; it must not end the mind
        _not_handled(mind, mail, as_failed(error))


def handle(mind: Mind, mail: Mail) -> None:
    """Do what a message asks for, as the built-in plans for ``+!kqml_received``. Raises `Failed` where these fail."""
    _HANDLERS.get(mail.performative, _nobody_handles)(mind, mail)


def _nobody_handles(mind: Mind, mail: Mail) -> None:
    raise Failed("no_applicable", f"nobody handles the performative {mail.performative}")


def handle_event(mind: Mind, args: tuple[Any, ...], intention: Any) -> None:
    """``+!kqml_received(Sender, Performative, Content, Id)`` that no plan of the program is applicable to."""
    sender, performative, content, msg_id = (deref(resolve(a)) for a in args)
    mail = Mail(plain(sender), plain(performative), content, plain(msg_id))
    try:
        handle(mind, mail)
    except Exception as error:  # a function of the program's may raise anything; it must not end the mind
        _not_handled(mind, mail, as_failed(error))
    if intention is not None:
        resume_waiting(mind, intention)


def plain(term: Any) -> str:
    """A name or id as the plans for messages get it: an atom or a string."""
    return term if type(term) is str else text(term)


def _not_handled(mind: Mind, mail: Mail, failed: Failed) -> None:
    """A message that cannot be handled: the program's own ``-!kqml_received`` is asked, else it is told."""
    event = Literal(mind.plans.kqml.sig, (atom(mail.sender), atom(mail.performative), mail.content, mail.msg_id))
    handler = mind.plans.kqml.counterpart("-")
    if handler.plans:
        mind.post(handler, detach(event.args), error_annots(failed, event, 0, ""))
        return
    what = str(failed)
    if failed.error == "no_applicable":
        what = f"Found a goal for which there is no applicable plan: +!{text(event)} ({what})"
    communication_error(mind, failed.error, what)


def told_annots(mind: Mind, literal: Literal, sender: str) -> tuple[Any, ...]:
    """The annotations of a literal as told by somebody: its former sources stand inside the new one."""
    if sender == mind.name:
        sender = "self"
    if not literal.annots:
        return SELF if sender == "self" else told_by(sender)
    others = [a for a in literal.annots if not is_source(a)]
    inner = tuple(a for a in literal.annots if is_source(a) and a != SOURCE_SELF)
    who = source(atom(sender))
    return sorted_annots((*others, who.with_annots(inner) if inner else who))


def _each(content: Any) -> Iterable[Any]:
    if type(content) is Literal:
        return (content,)
    members = proper(content)
    return [content] if members is None else members


def _tell(mind: Mind, mail: Mail) -> None:
    for content in _each(mail.content):
        if type(content) is not Literal:
            content = deref(content)
        if type(content) is Literal:
            args = content.args if content.ground else detach(resolve_all(content.args))
            predicate = mind.beliefs.predicate(content.sig)
            relevant = mind.plans.relevant("+", "", content.sig)
            believe(mind, None, predicate, relevant, args, told_annots(mind, content, mail.sender))
        elif content is mail.content:
            raise Failed("no_applicable", "only literals can be told")


def _untell(mind: Mind, mail: Mail) -> None:
    content = deref(mail.content)
    if type(content) is not Literal:
        raise Failed("no_applicable", "only a literal can be untold")
    predicate = mind.beliefs.predicate(content.sig)
    relevant = mind.plans.relevant("-", "", content.sig)
    trail: list[Var] = []
    disbelieve(mind, None, predicate, relevant, content.args, told_annots(mind, content, mail.sender), trail)


def _achieve(mind: Mind, mail: Mail) -> None:
    if type(mail.content) is Literal:
        _achieve_literal(mind, mail.content, mail.sender)
        return
    for content in _each(mail.content):
        content = deref(content)
        if type(content) is Literal:
            _achieve_literal(mind, content, mail.sender)
        elif content is mail.content:
            raise Failed("body_var_not_literal", f"{text(content)} is no goal to achieve")


def _achieve_literal(mind: Mind, goal: Literal, sender: str) -> None:
    relevant = mind.plans.relevant("+", "!", goal.sig)
    annots = told_annots(mind, goal, sender)
    if mind.plans.has_meta:
        raise_state(mind, relevant, goal.args, annots, "pending")
    mind.post(relevant, goal.args if goal.ground else detach(goal.args), annots)


def _unachieve(mind: Mind, mail: Mail) -> None:
    content = deref(mail.content)
    if type(content) is not Literal:
        wrong_arguments(f"{text(content)} is no goal to drop")
    drop_desire(mind, content, [])


def _signal(mind: Mind, mail: Mail) -> None:
    content = deref(mail.content)
    if type(content) is not Literal:
        raise Failed("unknown", f"{text(content)} is no event to signal")
    annots = told_annots(mind, content, mail.sender)
    relevant = mind.plans.relevant("+", "", content.sig)
    if mind.listeners:
        hear(mind, relevant, content.args, annots)
    mind.post(relevant, content.args, annots)


def _ask_one(mind: Mind, mail: Mail) -> None:
    found = answers(mind, mail, 1)
    if found is None:
        reply(mind, mail, FALSE)
        return
    if found:
        reply(mind, mail, answer_text(mind, found[0]))
        return
    question = Copier(fresh=True).copy(mail.content)
    if type(question) is Literal:
        relevant = mind.plans.relevant("+", "?", question.sig)
        if relevant.plans:
            _ask_plan(mind, mail, relevant, question)
            return
    reply(mind, mail, FALSE)


def _ask_plan(mind: Mind, mail: Mail, relevant: Any, question: Literal) -> None:
    """Let a ``+?`` plan find the answer: an intention that tells it when the plan has ended."""
    answer_by_plan(mind, mail, relevant, question, told_annots(mind, question, mail.sender))


def _ask_all(mind: Mind, mail: Mail) -> None:
    found = [answer_text(mind, a) for a in answers(mind, mail) or ()]
    if mail.msg_id.startswith("sync") or found:
        reply(mind, mail, make_list(found))


def _ask_how(mind: Mind, mail: Mail) -> None:
    found = relevant_plans(mind, mail.content, told_by=atom(mind.name))
    if not mail.msg_id.startswith("sync"):
        if found:
            send(mind, mail.sender, "tellHow", make_list(found), mail.msg_id)
        return
    send(mind, mail.sender, "tell", make_list(found), mail.msg_id)


def _tell_how(mind: Mind, mail: Mail) -> None:
    add_plans(mind, mail.content, atom(mail.sender), first=False)


def _untell_how(mind: Mind, mail: Mail) -> None:
    remove_plans(mind, mail.content, atom(mail.sender))


_HANDLERS: Final[dict[str, Callable[[Any, Mail], None]]] = {
    "tell": _tell,
    "untell": _untell,
    "achieve": _achieve,
    "unachieve": _unachieve,
    "signal": _signal,
    "askOne": _ask_one,
    "askIf": _ask_one,
    "askAll": _ask_all,
    "askHow": _ask_how,
    "tellHow": _tell_how,
    "untellHow": _untell_how,
}
