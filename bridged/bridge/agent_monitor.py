"""Watching a robot's agents: when the one that acted last is gone, hangs or is idle, its mission says what is done."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping

from bridged.bridge.bridge import Bridge
from bridged.bridge.idle_monitor import Idleness
from bridged.bridge.robot_setup import RobotSetup
from commd.bus.bus import Bus
from commd.common.clock import Clock
from commd.common.tasks import wait_at_most
from commd.liveness.presence import Presence, Silence
from schemas.wire import keys
from schemas.wire.records import Health

WATCH_EVERY = 0.5
"""Wall seconds between two looks at who is there."""
log = logging.getLogger("bridged")


async def watch_agents(bus: Bus, part: RobotSetup, boards: Mapping[str, str], bridge: Bridge, clock: Clock) -> None:
    """Do what the mission says when the agent that acted last is gone, or none intends anything with a flying robot.

    `boards` says where each agent lives. One that says nothing for the robot's `agent_silence` is as good as gone.
    """
    agents, patience = part.agents, part.silence
    presence, silence, changed = Presence(agents, boards.get), Silence(patience), asyncio.Event()
    idleness = Idleness(part.idle_after)
    presence.expect(bridge.lease.answers, clock.wall())  # who had the robot in our last life may have died with it

    def token(key: str, alive: bool) -> None:
        if parsed := keys.parse(key):
            name, (daemon, boot) = parsed[1], parsed[2][-2:]
            presence.token(name, boot, alive, clock.wall())
            if not alive:
                idleness.gone(name)
            if daemon == "agentd":  # a client of another kind puts no health
                silence.token(name, boot, alive, clock.wall())
            changed.set()

    def word(key: str, health: Health) -> None:
        if parsed := keys.parse(key):
            silence.word(parsed[1], health.header.boot, clock.wall())
            idleness.told(parsed[1], health.idle)
            if parsed[1] in lost:
                changed.set()

    def board(key: str, alive: bool) -> None:
        if parsed := keys.parse(key):
            presence.board(parsed[1], parsed[2][-1], alive, clock.wall())
            changed.set()

    def router(up: bool) -> None:
        presence.router(up, clock.wall())
        silence.excuse(clock.wall(), patience)
        changed.set()

    bus.on_router(router)
    for name in sorted({boards[agent] for agent in agents if agent in boards}):
        bus.watch(keys.alive(bus.fleet, name, "commd", "*"), board)
    for agent in agents:
        bus.watch(keys.alive(bus.fleet, agent, "*", "*"), token)  # of an agentd, or of a client that is its own daemon
        bus.subscribe(keys.health(bus.fleet, agent, "agentd"), Health, word)
    lost: set[str] = set()
    while True:
        now_lost = presence.lost(clock.wall())
        for agent in silence.silent(clock.wall()):
            now_lost.setdefault(agent, f"it is there and has said nothing for {patience:g} s: it hangs")
        bridge.lease.present = presence.there() - set(now_lost)
        for agent, why in now_lost.items():
            if agent not in lost and agent == bridge.lease.answers:
                bridge.orders.agent_lost(agent, why, part.steps)
        for agent in lost - set(now_lost):
            log.info("agent %s is back", agent)
            if agent == bridge.lease.answers:
                bridge.orders.agent_back(agent)
        lost = set(now_lost)
        gone = bridge.lease.answers in lost
        idle = idleness.look(bridge.lease.present, bridge.orders.unattended, clock.now(), clock.wall(), lost=gone)
        bridge.orders.agents_idle(idle, part.idle_steps, lost=gone)
        somebody = bool(presence.known() - lost) or not bridge.driver.active
        bridge.driver.speak_for_agent(not gone and somebody)
        changed.clear()
        await wait_at_most(changed, WATCH_EVERY)
