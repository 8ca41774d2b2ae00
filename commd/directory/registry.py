"""What the agents of a board offer and want, who joined them at run time, and what is known of the other boards.

Pure: requests and what boards say go in; the next state and the notices that it calls for come out, so that a caller
can write both to disk before either counts.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import TypeAlias

import msgspec

from schemas.wire.keys import check_name
from schemas.wire.records import BoardServices, Note

log = logging.getLogger("directory")

MOST_JOINED = 10_000
"""Agents made at run time that one board takes."""
MOST_SERVICES = 1_000
"""Services that one agent offers."""
LONGEST_SERVICE = 1_000
"""Characters of the name of a service."""
MOST_NAMES = 2 * MOST_JOINED
"""Agents of another board that are known here: those that joined it, and the mission's."""
Notice: TypeAlias = tuple[str, str, str]
"""A subscriber, and the agent and service that it is to be told of."""


class Own(msgspec.Struct, frozen=True, omit_defaults=True):
    """What a board keeps of its own agents; it is on disk as this."""

    version: int = 0
    """Counts the changes that other boards see."""
    joined: tuple[str, ...] = ()
    """The agents that the mission does not name."""
    staying: tuple[str, ...] = ()
    """Those of them that keep their mailbox while they are away."""
    offers: dict[str, tuple[str, ...]] = {}
    """The services of each agent that offers any, in the order in which they were registered."""
    wants: dict[str, tuple[str, ...]] = {}
    """The subscribers of each service that has any."""


class Problem(ValueError):
    """Why a request is not fulfilled, in words."""


@dataclass(frozen=True)
class Services:
    """The agents of a fleet and their services, as one board knows them."""

    board: str
    mission: Mapping[str, str]
    """Who the mission names as a receiver of mail, and the board of each."""
    boards: tuple[str, ...]
    """In the order of the mission, in which agents are listed as well."""
    reserved: frozenset[str] = frozenset()
    """Further names that are taken: robots and boards."""
    prefix: str = ""
    """What names made at run time begin with: where access is controlled, others may not be spoken for."""
    own: Own = field(default_factory=Own)
    others: Mapping[str, BoardServices] = field(default_factory=dict)
    """What each other board has said last."""

    # --- who is where ---

    def agents(self) -> dict[str, tuple[str, ...]]:
        """The agents of this board and what they offer."""
        of_mission = [name for name, board in self.mission.items() if board == self.board]
        return {name: self.own.offers.get(name, ()) for name in (*of_mission, *self.own.joined)}

    def joined(self) -> Iterator[tuple[str, str]]:
        """Those that the mission does not name, and their boards; of a name that two boards have, ours comes first."""
        for name in self.own.joined:
            yield name, self.board
        for board in self.boards:
            if board in self.others:
                for name in self.others[board].agents:
                    if name not in self.mission:
                        yield name, board

    def homes(self) -> dict[str, str]:
        """Everybody who can be sent to, there or away, and the board that keeps their mail; the mission's first."""
        homes = dict(self.mission)
        for name, board in self.joined():
            homes.setdefault(name, board)
        return homes

    def doubled(self) -> list[Note]:
        """Return the agents that have joined two boards: they did while the boards could not see one another."""
        first: dict[str, str] = {}
        found = []
        for name, board in self.joined():
            if first.setdefault(name, board) != board:
                text = f"agent `{name}` has joined two boards: {first[name]} and {board}"
                found.append(Note("agent_twice", text, name))
        return found

    def providers(self, service: str) -> tuple[str, ...]:
        """The agents of the fleet that offer a service."""
        found = []
        for board in self.boards:
            offers = self.agents() if board == self.board else self._offers_of(self.others.get(board))
            found += [name for name, services in offers.items() if service in services]
        return tuple(dict.fromkeys(found))

    # --- requests of the agents here ---

    def join(self, agent: str, stays: bool = False) -> Services:
        """An agent that the mission does not name begins here; again after a restart is no problem.

        Raises Problem. One that `stays` is known until it leaves, however long it is away.
        """
        try:
            check_name(agent)
        except ValueError as error:
            raise Problem(str(error)) from None
        home = self.homes().get(agent)
        if home == self.board:
            if agent in self.mission or stays == (agent in self.own.staying):
                return self
            return self._with(staying=(*self.own.staying, agent) if stays else _without(self.own.staying, agent))
        if home is not None or agent in self.reserved:
            raise Problem(f"the name `{agent}` is taken" + (f" on board {home}" if home is not None else ""))
        if not agent.startswith(self.prefix):
            example = f"{self.prefix}{agent}"
            raise Problem(f"names made on board {self.board} begin with `{self.prefix}`, such as `{example}`")
        if len(self.own.joined) >= MOST_JOINED:
            raise Problem(f"board {self.board} takes at most {MOST_JOINED} agents besides the mission's")
        staying = (*self.own.staying, agent) if stays else self.own.staying
        return self._changed(joined=(*self.own.joined, agent), staying=staying)

    def leave(self, agent: str) -> Services:
        """An agent has ended for good, or begins anew: it offers and wants nothing any more."""
        offers = {name: services for name, services in self.own.offers.items() if name != agent}
        wants = {name: left for name, who in self.own.wants.items() if (left := _without(who, agent))}
        joined, staying = _without(self.own.joined, agent), _without(self.own.staying, agent)
        if (offers, wants, joined) == (self.own.offers, self.own.wants, self.own.joined):
            return self
        return self._changed(offers=offers, wants=wants, joined=joined, staying=staying)

    def register(self, agent: str, service: str) -> tuple[Services, list[Notice]]:
        """An agent offers a service; the subscribers here are told once."""
        self._check(agent, service)
        offered = self.own.offers.get(agent, ())
        if service in offered:
            return self, []
        if len(offered) >= MOST_SERVICES:
            raise Problem(f"an agent offers at most {MOST_SERVICES} services")
        notices = [(subscriber, agent, service) for subscriber in self.own.wants.get(service, ())]
        return self._changed(offers={**self.own.offers, agent: (*offered, service)}), notices

    def deregister(self, agent: str, service: str) -> Services:
        """An agent offers a service no longer; nobody is told."""
        self._check(agent, service)
        offered = self.own.offers.get(agent, ())
        if service not in offered:
            return self
        offers = {**self.own.offers, agent: _without(offered, service)}
        return self._changed(offers={name: services for name, services in offers.items() if services})

    def subscribe(self, agent: str, service: str) -> tuple[Services, list[Notice]]:
        """An agent is to be told of those who offer a service: of those there now, and of each one to come."""
        self._check(agent, service)
        notices = [(agent, provider, service) for provider in self.providers(service)]
        known = self.own.wants.get(service, ())
        if agent in known:
            return self, notices
        wants = {**self.own.wants, service: (*known, agent)}
        return self._with(wants=wants), notices

    # --- what other boards say ---

    def news(self, said: BoardServices) -> bool:
        """Whether a board says something newer than what is known of it: another life of its daemon, or a change."""
        known = self.others.get(said.board)
        return known is None or said.header.boot != known.header.boot or said.version > known.version

    def heard(self, said: BoardServices) -> tuple[Services, list[Notice], list[str]]:
        """Take what another board says: with the notices for subscribers here, and who is gone for good."""
        after = replace(self, others={**self.others, said.board: said})
        before = self._offers_of(self.others.get(said.board))
        notices = [
            (subscriber, agent, service)
            for agent, services in after._offers_of(said).items()
            for service in services
            if service not in before.get(agent, ())
            for subscriber in self.own.wants.get(service, ())
        ]
        homes = after.homes()
        return after, notices, [agent for agent in before if agent not in homes]

    def _offers_of(self, said: BoardServices | None) -> dict[str, tuple[str, ...]]:
        """What a board says of the agents that are its own: those of the mission belong where the mission says."""
        if said is None:
            return {}
        return {name: what for name, what in said.agents.items() if self.mission.get(name, said.board) == said.board}

    def _check(self, agent: str, service: str) -> None:
        if agent not in self.own.joined and self.mission.get(agent) != self.board:
            home = self.homes().get(agent)
            raise Problem(f"`{agent}` is no agent of board {self.board}" + (f" but of {home}" if home else ""))
        if not 0 < len(service) <= LONGEST_SERVICE:
            raise Problem(f"expected the name of a service, of at most {LONGEST_SERVICE} characters")

    def _changed(self, **changes: object) -> Services:
        """Change what other boards see."""
        return self._with(version=self.own.version + 1, **changes)

    def _with(self, **changes: object) -> Services:
        return replace(self, own=msgspec.structs.replace(self.own, **changes))


def checked(said: BoardServices, may_name: Callable[[str], bool] = lambda _: True) -> BoardServices:
    """Take from what another board says what can be meant: names that a key can hold and that this board `may_name`,
    and no more than a board has."""
    good = {name: _services(what) for name, what in said.agents.items() if _is_name(name) and may_name(name)}
    agents = dict(islice(good.items(), MOST_NAMES))
    if agents == said.agents:
        return said
    log.warning("board=%s what it says is taken in part: %d of %d agents", said.board, len(agents), len(said.agents))
    return msgspec.structs.replace(said, agents=agents)


def _services(offered: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(one for one in offered[:MOST_SERVICES] if 0 < len(one) <= LONGEST_SERVICE)


def _is_name(name: str) -> bool:
    try:
        check_name(name)
    except ValueError:
        return False
    return True


def _without(names: tuple[str, ...], name: str) -> tuple[str, ...]:
    return tuple(one for one in names if one != name)
