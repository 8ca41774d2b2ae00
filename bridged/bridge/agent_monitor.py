"""Watching a robot's agents: when the one that acted last is gone, hangs or is idle, its mission says what is done."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Collection

from bridged.bridge.bridge import Bridge
from bridged.bridge.robot_setup import RobotSetup
from commd.bus.bus import Bus
from commd.common.clock import Clock
from commd.common.tasks import in_step, wait_at_most
from commd.liveness.presence import Presence, Silence
from schemas.mission.model import Mission
from schemas.wire import keys
from schemas.wire.health import agents_of
from schemas.wire.records import Health

LEAST = 3.0
"""Wall seconds at least, at any speed: agents report once a second whether they are idle."""


class Idleness:
    """Judges the agents of one robot: they are idle when each one present reports that it is idle.

    A client of `commd.client` never reports it: it may act at any time.
    """

    def __init__(self, after: float) -> None:
        """`after`: mission seconds."""
        self._after = after
        self._idle: dict[str, bool] = {}
        self._since: tuple[float, float] | None = None
        """Mission and wall seconds."""

    def told(self, agent: str, idle: bool | None) -> None:
        """Take in the health of an agent; None: it does not report whether it is idle."""
        self._idle[agent] = idle is True

    def gone(self, agent: str) -> None:
        """Forget what an agent reported: it has ended."""
        self._idle.pop(agent, None)

    def look(self, there: Collection[str], unattended: bool, now: float, wall: float, *, lost: bool = False) -> float:
        """Return for how many mission seconds the robot has been unattended; 0 until `after` is over.

        `lost`: the agent that answers for it is lost; the others' intentions then do not count.
        """
        idle = bool(there) and all(self._idle.get(agent, False) for agent in there)
        if not (unattended and (lost or idle)):
            self._since = None
            return 0.0
        if self._since is None:
            self._since = now, wall
        begun, begun_wall = self._since
        over = now - begun >= self._after and wall - begun_wall >= LEAST
        return now - begun if over else 0.0


WATCH_EVERY = 0.5
"""Wall seconds between two looks at who is there."""
log = logging.getLogger("bridged")


async def watch_agents(bus: Bus, mission: Mission, part: RobotSetup, bridge: Bridge, clock: Clock) -> None:
    """Do what the mission says when the agent that acted last is gone, or none intends anything with a flying robot.

    An agent that is silent for the robot's `agent_silence` counts as lost, and so does one that reports that it does
    not command this robot: its daemon has read an edited mission.
    """
    robot, agents = mission.robots[part.name], part.agents
    boards, patience = mission.mailboxes, robot.agent_silence
    presence, silence = Presence({*agents, bridge.lease.answers} - {""}, boards.get), Silence(patience)
    hangs = "it hangs, or an edited mission runs it on another board" if mission.boards else "it hangs"
    changed = asyncio.Event()
    idleness = Idleness(robot.idle_after)

    def token(key: str, alive: bool) -> None:
        if parsed := keys.parse(key):
            name, (daemon, boot) = parsed[1], parsed[2][-2:]
            presence.token(name, boot, alive, clock.wall())
            if not alive:
                idleness.gone(name)
            if daemon == "agentd":  # its health says which robot it commands
                silence.token(name, boot, alive, clock.wall())
            elif alive:  # a client of another kind puts no health
                elsewhere.pop(name, None)
            changed.set()

    def word(key: str, health: Health) -> None:
        if parsed := keys.parse(key):
            for name, its in agents_of(parsed[1], health, agents, boards.get):
                silence.word(name, health.header.boot, clock.wall())
                idleness.told(name, its.idle)
                if its.robot in (None, part.name):
                    elsewhere.pop(name, None)
                else:
                    elsewhere[name] = f"by the mission that its agentd has read it commands {its.robot or 'no robot'}"
                if (name in lost) != (name in elsewhere):
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
        bus.subscribe(keys.health(bus.fleet, name, "agentd"), Health, word)
    for agent in agents:
        bus.watch(keys.alive(bus.fleet, agent, "*", "*"), token)  # of an agentd, or of a client that is its own daemon
    lost: dict[str, str] = {}
    elsewhere: dict[str, str] = {}
    while True:
        if bridge.lease.inherited:  # it may have ended before or with the last run, or the mission has it no more
            presence.expect(bridge.lease.answers, clock.wall())
        now_lost = elsewhere | presence.lost(clock.wall())
        for agent in silence.silent(clock.wall()):
            now_lost.setdefault(agent, f"it is present and has been silent for {patience:g} s: {hangs}")
        bridge.lease.present = presence.there() - set(now_lost)
        for agent, why in now_lost.items():  # a silent one may act, and end then
            news = agent not in lost or (lost[agent] != why and bridge.orders.lost_agent != agent)
            if news and agent == bridge.lease.answers:
                bridge.orders.agent_lost(agent, why, part.steps)
        for agent in lost.keys() - now_lost.keys():
            log.info("agent %s is back", agent)
            if agent == bridge.lease.answers:
                bridge.orders.agent_back(agent)
        lost = now_lost
        gone = bridge.lease.answers in lost
        idle = idleness.look(bridge.lease.present, bridge.orders.unattended, clock.now(), clock.wall(), lost=gone)
        bridge.orders.agents_idle(idle, part.idle_steps, lost=gone)
        somebody = bool(presence.known() - lost.keys()) or not bridge.driver.active
        bridge.driver.speak_for_agent(not gone and somebody)
        changed.clear()
        await wait_at_most(changed, in_step(asyncio.get_running_loop().time(), WATCH_EVERY))
