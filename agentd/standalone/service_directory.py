"""The directory of services (``.df_*``): who offers what, and who wants to be told of it."""

from __future__ import annotations

from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.terms import Literal, atom

_PROVIDER = signature("provider", 2)


class Directory:
    """The services of the agents of one team, in the order in which they were registered."""

    def __init__(self) -> None:
        self._offered: list[tuple[str, str]] = []
        self._wanted: list[tuple[str, str]] = []

    def register(self, agent: str, service: str) -> list[str]:
        """Note that an agent offers a service. Returns the subscribers to be told of it."""
        if (agent, service) in self._offered:
            return []
        self._offered.append((agent, service))
        return [subscriber for subscriber, wanted in self._wanted if wanted == service]

    def deregister(self, agent: str, service: str) -> None:
        """The agent offers the service no longer; nobody is told."""
        self._offered = [entry for entry in self._offered if entry != (agent, service)]

    def search(self, service: str) -> list[str]:
        """The agents that offer a service."""
        return [agent for agent, offered in self._offered if offered == service]

    def subscribe(self, agent: str, service: str) -> list[str]:
        """Tell an agent of those who will offer a service. Returns those who do already."""
        if (agent, service) not in self._wanted:
            self._wanted.append((agent, service))
        return self.search(service)

    def forget(self, agent: str) -> None:
        """The agent is gone."""
        self._offered = [entry for entry in self._offered if entry[0] != agent]
        self._wanted = [entry for entry in self._wanted if entry[0] != agent]


def provider(agent: str, service: str) -> Literal:
    """What a subscriber believes: ``provider(Agent, Service)``."""
    return Literal(_PROVIDER, (atom(agent), atom(service)))
