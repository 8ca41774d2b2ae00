"""Messages that go out: ids, answers, and how a belief is told to others."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from agentd.language.order import sorted_annots
from agentd.language.sources import SOURCE_SELF, is_source, source
from agentd.language.terms import FALSE, Literal, atom
from agentd.mind.effects import SendMail
from agentd.mind.inputs import Mail
from agentd.mind.resolving import Copier

if TYPE_CHECKING:
    from agentd.mind.mind import Mind


def send(
    mind: Mind, receiver: str | None, performative: str, content: Any, in_reply_to: str = "", kind: str = "mid"
) -> str:
    """Hand a message out; returns its id, which begins with ``kind``: ``sync`` if the sender waits for an answer."""
    mind.message_count += 1
    msg_id = f"{kind}{mind.message_count}.{mind.name}"
    mind.effects.append(SendMail(receiver, performative, content, msg_id, in_reply_to))
    return msg_id


def reply(mind: Mind, mail: Mail, content: Any) -> None:
    """Answer a question: a synchronous one by a message in reply, another one by telling."""
    if not mail.msg_id.startswith("sync") and content is FALSE:
        return
    send(mind, mail.sender, "tell", content, mail.msg_id)


def answer_text(mind: Mind, literal: Any) -> Any:
    """A belief as an answer: source(self) becomes the name of this agent."""
    literal = Copier(fresh=True).copy(literal)
    if type(literal) is not Literal:
        return literal
    me = source(atom(mind.name))
    annots = tuple(me if a == SOURCE_SELF else a for a in literal.annots)
    if not any(map(is_source, annots)):
        annots = (*annots, me)
    return Literal(literal.sig, literal.args, sorted_annots(annots))
