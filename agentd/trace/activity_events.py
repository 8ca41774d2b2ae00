"""Events of one agent for observers: actions and their outcomes, mail, prints, orders of operators."""

from __future__ import annotations

from collections import deque
from typing import Final, Literal

from agentd.conversion.log_format import line_of
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms import terms
from agentd.mind.data.effects import Effect, Log, PerformAction, Print, StopTeam
from agentd.mind.data.inputs import ActionDone, Mail
from agentd.mind.introspection.snapshots import short_text
from agentd.trace.decision_digest import called
from commd.common.clock import Clock
from commd.mail.message import OFFICE
from schemas.wire.mind_records import ActivityEvent

MOST_LINES: Final = 100
"""Prints and logs in a batch: a flood of them must not hide the rest."""
MOST: Final = 300
"""Other events in a batch."""
LAST_ACTIONS: Final = 60
"""Actions and outcomes that are remembered without subscribers."""
LONGEST: Final = 2_000
"""Characters of a text."""
UNDELIVERED: Final = "undelivered"
Kind = Literal["print", "log", "action", "outcome", "sent", "received", "undelivered", "stopped"]
_DETAIL: Final = signature("detail", 1)
"""The annotation of a notice with more than its code."""


def _speech(mail: Mail) -> dict[str, str]:
    return {"performative": mail.performative, "in_reply_to": mail.in_reply_to}


class ActivityEvents:
    """The events of one agent since the last `take`."""

    def __init__(self, agent: str, boot: str, agent_boot: str, clock: Clock) -> None:
        """`boot` and `agent_boot` are parts of the ids of the agent's actions and messages on the bus."""
        self.listened = False
        self.actions: deque[ActivityEvent] = deque(maxlen=LAST_ACTIONS)
        """The last actions and their outcomes."""
        self._agent, self._now = agent, clock.now
        self._action_ids, self._mail_ids = f"{agent}:{boot}:", f".{agent_boot}"
        """How the ids of actions begin, and how those of messages end."""
        self._new: list[ActivityEvent] = []
        self._lines = self._left_out = 0

    def did(self, cycle: int, effect: Effect) -> None:
        """Note an effect of the cycle with this number (0 or more)."""
        match effect:
            case PerformAction(id=number, name=name, parameters=parameters):
                self._action(self._event(cycle, "action", called(name, parameters), id=f"{self._action_ids}{number}"))
            case _ if not self.listened:
                pass
            case Print() | Log() if self._lines >= MOST_LINES:
                self._left_out += 1
            case Print(text=text):
                self._lines += 1
                self._new.append(self._event(cycle, "print", text))
            case Log(level=level):
                self._lines += 1
                self._new.append(self._event(cycle, "log", line_of(effect), state=level))
            case StopTeam(exit_code=code, delay=delay):
                self.add(self._event(cycle, "stopped", f"it stops the team in {delay:g} s with exit code {code}"))
            case _:
                pass

    def sent(self, cycle: int, mail: Mail, receivers: list[str]) -> None:
        """Note a message that the outbox has accepted, once for each receiver."""
        if self._is_full():
            self._left_out += len(receivers)
            return
        text, identity = short_text(mail.content), f"{mail.msg_id}{self._mail_ids}"
        for receiver in receivers:
            self.add(self._event(cycle, "sent", text, id=identity, other=receiver, **_speech(mail)))

    def ended(self, cycle: int, done: ActionDone) -> None:
        """Note the end of an action that the cycle with this number (0 or more), or the next one, takes."""
        identity = f"{self._action_ids}{done.id}"
        self._action(self._event(cycle, "outcome", id=identity, state=done.state, reason=done.reason))

    def given(self, cycle: int, mail: Mail) -> None:
        """Note a message that the cycle with this number (0 or more) takes, while there are subscribers."""
        if self._is_full():
            self._left_out += 1
        else:
            self.add(self._undelivered(cycle, mail) or self._received(cycle, mail))

    def _received(self, cycle: int, mail: Mail) -> ActivityEvent:
        speech = _speech(mail)
        if mail.in_reply_to.endswith(f".{self._agent}"):
            speech["in_reply_to"] = f"{mail.in_reply_to}{self._mail_ids}"
        return self._event(cycle, "received", short_text(mail.content), id=mail.msg_id, other=mail.sender, **speech)

    def _undelivered(self, cycle: int, mail: Mail) -> ActivityEvent | None:
        """Return the event of a notice `undelivered(Receiver, Performative, Content, Why)`; None for other mail."""
        notice = mail.content
        if (
            mail.sender != OFFICE
            or type(notice) is not terms.Literal
            or notice.sig.functor != UNDELIVERED
            or len(notice.args) < 4
        ):
            return None
        receiver, performative, content = map(short_text, notice.args[:3])
        details = (one.args[0] for one in notice.annots if type(one) is terms.Literal and one.sig == _DETAIL)
        return self._event(
            cycle,
            "undelivered",
            content,
            id=mail.msg_id.removeprefix(f"{UNDELIVERED}."),
            other=receiver,
            performative=performative,
            reason=str(next(details, notice.args[3])),
        )

    def _event(self, cycle: int, kind: Kind, text: str = "", **fields: str) -> ActivityEvent:
        return ActivityEvent(cycle=cycle, time=self._now(), kind=kind, text=text[:LONGEST], **fields)

    def _action(self, event: ActivityEvent) -> None:
        self.actions.append(event)
        if self.listened:
            self.add(event)

    def _is_full(self) -> bool:
        """Return whether further events are only counted, since converting them to text takes time."""
        return self.listened and len(self._new) - self._lines >= MOST

    def add(self, event: ActivityEvent) -> None:
        """Add an event while there are subscribers."""
        if self._is_full():
            self._left_out += 1
        elif self.listened:
            self._new.append(event)

    def take(self) -> tuple[tuple[ActivityEvent, ...], int]:
        """Return the events since the last call, and the number of those left out."""
        found = tuple(self._new), self._left_out
        self._new, self._lines, self._left_out = [], 0, 0
        return found
