"""Watching the tokens of a robot's agents: when the agent that acted last is gone, its mission says what is done."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping

from bridged.bridge import Bridge
from bridged.orders import Step
from commd.bus import Bus
from commd.clock import Clock
from commd.presence import Presence
from schemas import keys

WATCH_EVERY = 0.5
"""Wall seconds between two looks at who is there, while not everybody is."""
log = logging.getLogger("bridged")


async def watch_agents(
    bus: Bus, agents: list[str], boards: Mapping[str, str], bridge: Bridge, steps: tuple[Step, ...], clock: Clock
) -> None:
    """When the agent that acted last is gone, do what the mission declares; when it is back, leave it to the agent.

    `boards` says where each agent lives.
    """
    presence, changed = Presence(agents, boards.get), asyncio.Event()
    presence.expect(bridge.lease.answers, clock.wall())  # who had the robot in our last life may have died with it

    def token(key: str, alive: bool) -> None:
        if parsed := keys.parse(key):
            presence.token(parsed[1], parsed[2][-1], alive, clock.wall())
            bridge.lease.present = presence.there()
            changed.set()

    def board(key: str, alive: bool) -> None:
        if parsed := keys.parse(key):
            presence.board(parsed[1], parsed[2][-1], alive, clock.wall())
            changed.set()

    def router(up: bool) -> None:
        presence.router(up, clock.wall())
        changed.set()

    bus.on_router(router)
    for name in sorted({boards[agent] for agent in agents if agent in boards}):
        bus.watch(keys.alive(bus.fleet, name, "commd", "*"), board)
    for agent in agents:
        bus.watch(keys.alive(bus.fleet, agent, "*", "*"), token)  # of an agentd, or of a client that is its own daemon
    lost: set[str] = set()
    bridge.lease.present = presence.there()
    while True:
        now_lost = presence.lost(clock.wall())
        for agent, why in now_lost.items():
            if agent not in lost and agent == bridge.lease.answers:
                bridge.orders.agent_lost(agent, why, steps)
        for agent in lost - set(now_lost):
            log.info("agent %s is back", agent)
            if agent == bridge.lease.answers:
                bridge.orders.call_off()
        lost = set(now_lost)
        somebody = bool(presence.known() - lost) or not bridge.driver.active
        bridge.driver.speak_for_agent(bridge.lease.answers not in lost and somebody)
        changed.clear()
        if presence.complete:
            await changed.wait()
        else:
            await asyncio.sleep(WATCH_EVERY)
