"""Messages between agents: what each performative does to the mind that gets it (rules 1 to 19 of messages)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from agentd.language.order import sorted_annots
from agentd.language.signatures import signature
from agentd.language.sources import SOURCE_SELF, is_source, source, told_by
from agentd.language.terms import FALSE, Literal, Var, atom, deref, make_list, proper
from agentd.mind.annotations import with_source
from agentd.mind.effects import Log, SendMail
from agentd.mind.failed import Failed
from agentd.mind.inputs import Mail
from agentd.mind.intentions import Intention
from agentd.mind.resolving import Copier, detach, resolve
from agentd.mind.solve import solve
from agentd.mind.unifier import undo, unify

_KQML = signature("kqml_received", 4)


def receive(mind: Any, mail: Mail) -> None:
    """Handle one message."""
    if mail.in_reply_to and mail.in_reply_to in mind.questions:
        mind.questions[mail.in_reply_to].answered(mind, mail)
        return
    if mail.in_reply_to.startswith("sync"):
        return  # the answer to a question that nobody waits for any more
    custom = mind.plans.known("+", "!", _KQML)
    if custom is not None and custom.plans:
        args = (atom(mail.sender), atom(mail.performative), mail.content, mail.msg_id)
        if _has_plan(mind, custom, args):
            mind.post(custom, detach(args), ())
            return
    handler = _HANDLERS.get(mail.performative)
    if handler is None:
        text = f"nobody handles the performative {mail.performative} of a message from {mail.sender}"
        mind.effects.append(Log("warning", text))
        return
    try:
        handler(mind, mail)
    except Failed as failed:
        text = f"the message {mail.performative} from {mail.sender} cannot be handled: {failed}"
        mind.effects.append(Log("warning", text))


def _has_plan(mind: Any, relevant: Any, args: tuple[Any, ...]) -> bool:
    """Whether one of the program's own plans for messages is applicable to this one."""
    for plan in relevant.plans:
        trail: list[Var] = []
        frame = plan.select(mind, trail, relevant, args, ())
        undo(trail, 0)
        if frame is not None:
            return True
    return False


def from_sender(mind: Any, literal: Literal, sender: str) -> Literal:
    """A literal as told by somebody: its former sources stand inside the new one."""
    if sender == mind.name:
        return literal.with_annots(with_source(literal.annots))
    if not literal.annots:
        return literal.with_annots(told_by(sender))
    others = [a for a in literal.annots if not is_source(a)]
    inner = tuple(a for a in literal.annots if is_source(a) and a != SOURCE_SELF)
    who = source(atom(sender))
    return Literal(literal.sig, literal.args, sorted_annots((*others, who.with_annots(inner) if inner else who)))


def _each(content: Any) -> list[Any]:
    members = proper(content)
    return [content] if members is None else members


def _tell(mind: Any, mail: Mail) -> None:
    alone = proper(mail.content) is None
    for content in _each(mail.content):
        content = deref(content)
        if type(content) is Literal:
            mind.add_belief(from_sender(mind, content, mail.sender))
        elif alone:
            raise Failed("no_applicable", "only literals can be told")


def _untell(mind: Any, mail: Mail) -> None:
    content = deref(mail.content)
    if type(content) is not Literal:
        raise Failed("no_applicable", "only a literal can be untold")
    from agentd.mind.changes import disbelieve

    told = from_sender(mind, content, mail.sender)
    predicate = mind.beliefs.predicate(told.sig)
    trail: list[Var] = []
    disbelieve(mind, None, predicate, mind.plans.relevant("-", "", told.sig), told.args, told.annots, trail)


def _achieve(mind: Any, mail: Mail) -> None:
    for content in _each(mail.content):
        content = deref(content)
        if type(content) is Literal:
            mind.add_goal(from_sender(mind, content, mail.sender))


def _unachieve(mind: Any, mail: Mail) -> None:
    from agentd.mind.dropping import drop_desire

    content = deref(mail.content)
    if type(content) is Literal:
        drop_desire(mind, content, [])


def _signal(mind: Any, mail: Mail) -> None:
    content = deref(mail.content)
    if type(content) is Literal:
        told = from_sender(mind, content, mail.sender)
        relevant = mind.plans.relevant("+", "", told.sig)
        if mind.listeners:
            mind.hear(relevant, told.args, told.annots)
        mind.post(relevant, told.args, told.annots)


def reply(mind: Any, mail: Mail, content: Any) -> None:
    """Answer a question: a synchronous one by a message in reply, another one by telling."""
    if not mail.msg_id.startswith("sync") and content is FALSE:
        return
    send(mind, mail.sender, "tell", content, mail.msg_id)


def send(
    mind: Any, receiver: str | None, performative: str, content: Any, in_reply_to: str = "", sync: bool = False
) -> str:
    """Hand a message out; returns its id."""
    mind.message_count += 1
    msg_id = f"{'sync' if sync else 'mid'}{mind.message_count}.{mind.name}"
    mind.effects.append(SendMail(receiver, performative, content, msg_id, in_reply_to))
    return msg_id


def _answer_text(mind: Any, literal: Any) -> Any:
    """A belief as an answer: source(self) becomes the name of this agent."""
    literal = Copier(fresh=True).copy(literal)
    if type(literal) is not Literal:
        return literal
    me = source(atom(mind.name))
    annots = tuple(me if a == SOURCE_SELF else a for a in literal.annots)
    if not any(map(is_source, annots)):
        annots = (*annots, me)
    return Literal(literal.sig, literal.args, sorted_annots(annots))


def answers(mind: Any, question: Any) -> list[Any]:
    """All instances of a question that the beliefs give, with the annotations of the beliefs."""
    question = Copier(fresh=True).copy(question)
    found: list[Any] = []
    trail: list[Var] = []
    if type(question) is Literal:
        predicate = mind.beliefs.known(question.sig)
        if predicate is None:
            return []
        for args, annots in predicate.literals((True,) * question.sig.arity, question.args, mind, trail):
            if unify(question, Literal(question.sig, args, annots), trail):
                found.append(resolve(Literal(question.sig, args, annots)))
            undo(trail, 0)
        return found
    for _ in solve(mind, question, trail):
        found.append(resolve(question))
    undo(trail, 0)
    return found


def _ask_one(mind: Any, mail: Mail) -> None:
    found = answers(mind, mail.content)
    if found:
        reply(mind, mail, _answer_text(mind, found[0]))
        return
    question = Copier(fresh=True).copy(mail.content)
    if type(question) is Literal:
        relevant = mind.plans.relevant("+", "?", question.sig)
        if relevant.plans:
            _ask_plan(mind, mail, relevant, question)
            return
    reply(mind, mail, FALSE)


def _ask_plan(mind: Any, mail: Mail, relevant: Any, question: Literal) -> None:
    """Let a ``+?`` plan find the answer: an intention that tells it when the plan has ended."""
    from agentd.mind.answering import answer_by_plan

    told = from_sender(mind, question, mail.sender)
    answer_by_plan(mind, mail, relevant, question, told.annots)


def _ask_all(mind: Any, mail: Mail) -> None:
    found = [_answer_text(mind, a) for a in answers(mind, mail.content)]
    if mail.msg_id.startswith("sync") or found:
        reply(mind, mail, make_list(found))


def _ask_how(mind: Any, mail: Mail) -> None:
    from agentd.mind.plan_terms import relevant_plans

    found = relevant_plans(mind, mail.content)
    if not mail.msg_id.startswith("sync"):
        if found:
            send(mind, mail.sender, "tellHow", make_list(found), mail.msg_id)
        return
    send(mind, mail.sender, "tell", make_list(found), mail.msg_id)


def _tell_how(mind: Any, mail: Mail) -> None:
    from agentd.mind.plan_terms import add_plans

    add_plans(mind, mail.content, atom(mail.sender), first=False)


def _untell_how(mind: Any, mail: Mail) -> None:
    from agentd.mind.plan_terms import remove_plans

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


class Question:
    """A synchronous ask: the intention that waits, and for whose answers."""

    def __init__(self, intention: Intention, answer: Any, many: bool, wanted: int) -> None:
        self.intention, self.answer, self.many, self.wanted = intention, answer, many, wanted
        self.ids: list[str] = []
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
            mind.resume_waiting(self.intention)
        else:
            undo(trail, mark)
            mind.fail_waiting(self.intention, Failed("ask_failed", "the answer does not unify with what was expected"))
