"""The agents of a board, their services and subscriptions, those that joined at run time, and the other boards'
records.

Pure: requests and records go in; the next state and its notices come out, so that the caller can write both to disk
first.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import msgspec

from schemas.mission.access_rules import LONGEST_SERVICE, MOST_JOINED, MOST_SERVICES
from schemas.wire.keys import check_name
from schemas.wire.records import BoardServices, Note

Notice: TypeAlias = tuple[str, str, str]
"""A subscriber, and the agent and service of its notice."""


class Own(msgspec.Struct, frozen=True, omit_defaults=True):
    """A board's own agents, as on disk."""

    version: int = 0
    """Number of changes that other boards see."""
    joined: tuple[str, ...] = ()
    """Agents that are not in the mission."""
    staying: tuple[str, ...] = ()
    """Those that keep their mailbox while they are away."""
    offers: dict[str, tuple[str, ...]] = {}
    """Services by agent, in the order of registration."""
    wants: dict[str, tuple[str, ...]] = {}
    """Subscribers by service."""


class Problem(ValueError):
    """A request that is refused; the text says why."""


@dataclass(frozen=True)
class Services:
    """The agents of a fleet and their services, as known by one board."""

    board: str
    mission: Mapping[str, str]
    """Board of each receiver of mail in the mission."""
    boards: tuple[str, ...]
    """In the order of the mission, in which agents are listed too."""
    reserved: frozenset[str] = frozenset()
    """Other names in use: robots and boards."""
    prefix: str = ""
    """Prefix of names made at run time: where access is controlled, a board may not speak for other names."""
    own: Own = field(default_factory=Own)
    others: Mapping[str, BoardServices] = field(default_factory=dict)
    """The last record of each other board."""

    def agents(self) -> dict[str, tuple[str, ...]]:
        """Return the agents of this board and their services."""
        of_mission = [name for name, board in self.mission.items() if board == self.board]
        return {name: self.own.offers.get(name, ()) for name in (*of_mission, *self.own.joined)}

    def joined(self) -> Iterator[tuple[str, str]]:
        """Yield the agents that are not in the mission, and their boards; a name on two boards comes twice, ours
        first."""
        for name in self.own.joined:
            yield name, self.board
        for board in self.boards:
            if board in self.others:
                for name in self.others[board].agents:
                    if name not in self.mission:
                        yield name, board

    def homes(self) -> dict[str, str]:
        """Return all receivers of mail, present or away, with the boards of their mailboxes; the mission's first."""
        homes = dict(self.mission)
        for name, board in self.joined():
            homes.setdefault(name, board)
        return homes

    def doubled(self) -> list[Note]:
        """Return notes of agents that joined two boards, while these had no link."""
        first: dict[str, str] = {}
        found = []
        for name, board in self.joined():
            if first.setdefault(name, board) != board:
                text = f"agent `{name}` has joined two boards: {first[name]} and {board}"
                found.append(Note("agent_twice", text, name))
        return found

    def providers(self, service: str) -> tuple[str, ...]:
        """Return the agents of the fleet that offer a service."""
        found = []
        for board in self.boards:
            offers = self.agents() if board == self.board else self._offers_of(self.others.get(board))
            found += [name for name, services in offers.items() if service in services]
        return tuple(dict.fromkeys(found))

    def join(self, agent: str, stays: bool = False) -> Services:
        """Add an agent that is not in the mission; again after a restart is allowed. Raises Problem.

        An agent that `stays` is known until it leaves, however long it is away.
        """
        try:
            check_name(agent)
        except ValueError as error:
            raise Problem(str(error)) from None
        home = self.homes().get(agent)
        if home == self.board:
            if agent in self.mission or stays == (agent in self.own.staying):
                return self
            return self._with(staying=(*self.own.staying, agent) if stays else _without(self.own.staying, {agent}))
        if home is not None or agent in self.reserved:
            raise Problem(f"the name `{agent}` is taken" + (f" on board {home}" if home is not None else ""))
        if not agent.startswith(self.prefix):
            example = f"{self.prefix}{agent}"
            raise Problem(f"names made on board {self.board} begin with `{self.prefix}`, such as `{example}`")
        if len(self.own.joined) >= MOST_JOINED:
            raise Problem(f"board {self.board} takes at most {MOST_JOINED} agents besides the mission's")
        staying = (*self.own.staying, agent) if stays else self.own.staying
        return self._changed(joined=(*self.own.joined, agent), staying=staying)

    def leave(self, *agents: str) -> Services:
        """Remove all services and subscriptions of agents that have ended for good, or start over."""
        gone = frozenset(agents)
        offers = {name: services for name, services in self.own.offers.items() if name not in gone}
        wants = {name: left for name, who in self.own.wants.items() if (left := _without(who, gone))}
        joined, staying = _without(self.own.joined, gone), _without(self.own.staying, gone)
        if (offers, wants, joined) == (self.own.offers, self.own.wants, self.own.joined):
            return self
        return self._changed(offers=offers, wants=wants, joined=joined, staying=staying)

    def register(self, agent: str, service: str) -> tuple[Services, list[Notice]]:
        """Add a service of an agent, with notices to its subscribers here."""
        self._check(agent, service)
        offered = self.own.offers.get(agent, ())
        if service in offered:
            return self, []
        if len(offered) >= MOST_SERVICES:
            raise Problem(f"an agent offers at most {MOST_SERVICES} services")
        notices = [(subscriber, agent, service) for subscriber in self.own.wants.get(service, ())]
        return self._changed(offers={**self.own.offers, agent: (*offered, service)}), notices

    def deregister(self, agent: str, service: str) -> Services:
        """Remove a service of an agent, without notices."""
        self._check(agent, service)
        offered = self.own.offers.get(agent, ())
        if service not in offered:
            return self
        offers = {**self.own.offers, agent: _without(offered, {service})}
        return self._changed(offers={name: services for name, services in offers.items() if services})

    def subscribe(self, agent: str, service: str) -> tuple[Services, list[Notice]]:
        """Subscribe an agent to the providers of a service: to the present ones, and to later ones."""
        self._check(agent, service)
        notices = [(agent, provider, service) for provider in self.providers(service)]
        known = self.own.wants.get(service, ())
        if agent in known:
            return self, notices
        wants = {**self.own.wants, service: (*known, agent)}
        return self._with(wants=wants), notices

    def news(self, record: BoardServices) -> bool:
        """Return whether a record of a board is newer than the known one: from another process, or a change."""
        known = self.others.get(record.board)
        return known is None or record.header.boot != known.header.boot or record.version > known.version

    def heard(self, record: BoardServices) -> tuple[Services, list[Notice], list[str]]:
        """Apply a record of another board. Returns also the notices to subscribers here, and the agents that have
        left."""
        after = replace(self, others={**self.others, record.board: record})
        before = self._offers_of(self.others.get(record.board))
        notices = [
            (subscriber, agent, service)
            for agent, services in after._offers_of(record).items()
            for service in services
            if service not in before.get(agent, ())
            for subscriber in self.own.wants.get(service, ())
        ]
        homes = after.homes()
        return after, notices, [agent for agent in before if agent not in homes]

    def _offers_of(self, record: BoardServices | None) -> dict[str, tuple[str, ...]]:
        """Return the services of a board's own agents: the mission has the boards of its agents."""
        if record is None:
            return {}
        return {
            name: what for name, what in record.agents.items() if self.mission.get(name, record.board) == record.board
        }

    def _check(self, agent: str, service: str) -> None:
        if agent not in self.own.joined and self.mission.get(agent) != self.board:
            home = self.homes().get(agent)
            raise Problem(f"`{agent}` is no agent of board {self.board}" + (f" but of {home}" if home else ""))
        if not 0 < len(service) <= LONGEST_SERVICE:
            raise Problem(f"expected the name of a service, of at most {LONGEST_SERVICE} characters")

    def _changed(self, **changes: object) -> Services:
        """Make a change that other boards see."""
        return self._with(version=self.own.version + 1, **changes)

    def _with(self, **changes: object) -> Services:
        return replace(self, own=msgspec.structs.replace(self.own, **changes))


def _without(names: tuple[str, ...], gone: Collection[str]) -> tuple[str, ...]:
    return tuple(one for one in names if one not in gone)
