"""Which traces of a daemon's agents have subscribers.

The daemon has one listener for each channel, on the key expression of all agents. Only while that has a subscriber each
agent has listeners of its own, which tell whose trace it is: a listener costs half a millisecond of processor time, and
most daemons are watched by nobody.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Final, Literal, TypeAlias

from commd.bus.bus import Bus
from schemas.wire import keys

Channel: TypeAlias = Literal["inputs", "decisions", "activity"]
CHANNELS: Final[tuple[Channel, ...]] = ("inputs", "decisions", "activity")
Follow: TypeAlias = Callable[[Channel, bool], None]
"""Gets a channel, and whether it has subscribers now."""
AT_ONCE: Final = 20
"""Agents that get listeners of their own in one pass of the event loop."""


class TraceSubscribers:
    """Notifies the agents of one daemon which of their channels have subscribers."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._agents: dict[str, Follow] = {}
        self._somebody: set[Channel] = set()
        """Channels of which some agent of the fleet has subscribers."""
        self._own: dict[tuple[str, Channel], Callable[[], None]] = {}
        """What ends the listener of one agent."""
        self._listened: set[tuple[str, Channel]] = set()
        self._declaring: dict[Channel, asyncio.Task[None]] = {}
        for channel in CHANNELS:
            bus.listened(keys.trace(bus.fleet, "*", channel), partial(self._changed, channel))

    def add(self, agent: str, follow: Follow) -> None:
        """Call `follow` whenever the first subscriber to a channel of an agent appears or the last one ends."""
        self._agents[agent] = follow
        self.settle(agent)

    def settle(self, agent: str) -> None:
        """Call what is due for an agent before it answers a subscriber, who expects to hear all that follows.

        Zenoh reports the subscriber before the query that it sends next; a listener of the agent's own comes later."""
        for channel in self._somebody:
            self._listen(agent, channel)

    def remove(self, agent: str) -> None:
        """End the calls for an agent."""
        del self._agents[agent]
        for channel in CHANNELS:
            self._end(agent, channel)

    def _changed(self, channel: Channel, somebody: bool) -> None:
        if (task := self._declaring.pop(channel, None)) is not None:
            task.cancel()
        if somebody:
            self._somebody.add(channel)
            self._declaring[channel] = asyncio.get_running_loop().create_task(self._listen_to_all(channel))
            return
        self._somebody.discard(channel)
        for agent, follow in list(self._agents.items()):
            if self._end(agent, channel):
                follow(channel, False)

    def _changed_of(self, agent: str, channel: Channel, somebody: bool) -> None:
        (self._listened.add if somebody else self._listened.discard)((agent, channel))
        self._agents[agent](channel, somebody)

    async def _listen_to_all(self, channel: Channel) -> None:
        for number, agent in enumerate(list(self._agents)):
            if agent in self._agents:
                self._listen(agent, channel)
            if number % AT_ONCE == AT_ONCE - 1:
                await asyncio.sleep(0)

    def _listen(self, agent: str, channel: Channel) -> None:
        if (agent, channel) not in self._own:
            key = keys.trace(self._bus.fleet, agent, channel)
            self._own[agent, channel] = self._bus.listened(key, partial(self._changed_of, agent, channel))

    def _end(self, agent: str, channel: Channel) -> bool:
        """End the listener of one agent. Returns whether its last word was that there are subscribers."""
        if (withdraw := self._own.pop((agent, channel), None)) is not None:
            withdraw()
        there = (agent, channel) in self._listened
        self._listened.discard((agent, channel))
        return there
