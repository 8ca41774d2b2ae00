"""Which mail an agent accepts, and from whom: `accepts` in the mission, and the rule where it names nobody.

The board of a sender is the mission's word, or follows from a name made at run time: in a secured fleet the routers
hold each name to its board (`schemas.mission.access_rules`). Nothing else is taken from the message.
docs/guides/security.md has the table.
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.mission.access_rules import made_on
from schemas.mission.model import ALL, ANYBODY, RESERVED, Accepted, Mission
from schemas.wire.records import Message
from schemas.wire.terms import Structure

NOT_ACCEPTED = "not_accepted"
"""The reason that the sender of a refused message is told."""
NOTICES = {"mail": ("signal", "undelivered"), "df": ("tell", "provider")}
"""What the reserved senders are for: performative and functor."""
PLAN_MAIL = frozenset(("tellHow", "untellHow", "askHow"))
"""Changes a program, or reads it: refused from other boards of a secured fleet."""
FROM_GATEWAY = frozenset(("tell",))
"""What a node behind the gateway may send: UDP shows no key."""


@dataclass(frozen=True)
class MailRights:
    """What one agent accepts."""

    mission: Mission
    agent: str
    board: str
    """Where the agent runs."""

    def accept(self, message: Message) -> bool:
        """Whether the agent takes a message, judged by its sender and performative."""
        sender, performative = message.sender, message.performative
        if sender in RESERVED:
            content = message.content
            return isinstance(content, Structure) and NOTICES.get(sender) == (performative, content.functor)
        if sender == self.agent:
            return True
        if sender in self._named:
            return _holds(self._named[sender], performative)
        if ANYBODY in self._named and not _holds(self._named[ANYBODY], performative):
            return False
        gateway = self.mission.gateway
        if gateway is not None and sender in gateway.nodes:
            return performative in FROM_GATEWAY
        if ANYBODY in self._named or not self.mission.secured or self._is_neighbour(sender):
            return True
        return performative not in PLAN_MAIL

    @property
    def _named(self) -> dict[str, Accepted]:
        agent = self.mission.agents.get(self.agent)
        return {} if agent is None else agent.accepts

    def _is_neighbour(self, sender: str) -> bool:
        """Whether a sender runs on the same board."""
        home = self.mission.mailboxes.get(sender)
        return sender.startswith(made_on(self.board)) if home is None else home == self.board


def _holds(accepted: Accepted, performative: str) -> bool:
    return accepted == ALL or performative in accepted
