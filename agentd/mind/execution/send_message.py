"""Messages that go out: ids, answers, and how a belief is told to others."""

from __future__ import annotations

from typing import Any

from agentd.language.terms.source_annotations import SOURCE_SELF
from agentd.language.terms.terms import FALSE, Literal
from agentd.mind.beliefs.annotations import nested_source
from agentd.mind.beliefs.term_copy import Copier
from agentd.mind.data.effects import Log, SendMail
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.inputs import Mail
from agentd.mind.state import MindState


def send(
    mind: MindState, receiver: str | None, performative: str, content: Any, in_reply_to: str = "", kind: str = "mid"
) -> str:
    """Hand a message out; returns its id, which begins with ``kind``: ``sync`` if the sender waits for an answer.

    Fails with ``message_too_large``, ``mailbox_full`` or ``not_sendable`` if the mind's post office does not take it.
    """
    mind.message_count += 1
    msg_id = f"{kind}{mind.message_count}.{mind.name}"
    mail = SendMail(receiver, performative, content, msg_id, in_reply_to)
    if mind.post_office is None:
        mind.effects.append(mail)
    else:
        mind.post_office(mail)
    return msg_id


def reply(mind: MindState, mail: Mail, content: Any) -> None:
    """Answer a question: a synchronous one by a message in reply, another one by telling.

    An answer that cannot be sent is told in the log; who waits for it sees its time run out.
    """
    if not mail.msg_id.startswith("sync") and content is FALSE:
        return
    try:
        send(mind, mail.sender, "tell", content, mail.msg_id)
    except Failed as failed:
        mind.effects.append(Log("warning", f"the question of {mail.sender} gets no answer: {failed}"))


def answer_of(mind: MindState, mail: Mail, found: Any) -> Any:
    """What a question found, as its answer: a synchronous one names its source, others get it as what is told does."""
    answer = Copier(fresh=True).copy(found)
    if type(answer) is not Literal:
        return answer
    if mail.msg_id.startswith("sync"):
        return answer.with_annots(nested_source(answer.annots, mind.name))
    return answer.with_annots(tuple(a for a in answer.annots if a != SOURCE_SELF))
