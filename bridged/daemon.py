"""The bridge daemon: binds one robot to its agents."""

from __future__ import annotations

import asyncio
import logging
from argparse import ArgumentParser, Namespace
from pathlib import Path

from bridged.bridge import Bridge
from bridged.orders import Step
from bridged.preparation import prepare, state_directory
from bridged.presence import Presence
from bridged.service import Service
from commd.bus import Bus, open_bus
from commd.clock import Clock
from commd.process import EXIT_DONE, EXIT_FAILED, add_router_argument, report_health, run_daemon
from schemas import keys
from schemas.mission import Mission, load_mission

WATCH_EVERY = 0.5
"""Wall seconds between two looks at who is there, while not everybody is."""
log = logging.getLogger("bridged")


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `bridged serve`."""
    parser.add_argument("mission", help="mission file")
    parser.add_argument("robot", help="which robot of the mission")
    add_router_argument(parser)
    parser.add_argument("--speed", type=float, metavar="X", help="instead of the mission's; simulation only")
    parser.add_argument("--state", type=Path, metavar="DIR", help="where action ids are kept")
    parser.add_argument("--link", help="link to the robot instead of the mission's")


def run(args: Namespace) -> int:
    """Run the daemon until it is told to stop. Returns the exit code."""
    return run_daemon("bridged", lambda stop: serve(load_mission(args.mission), args, stop))


async def serve(mission: Mission, args: Namespace, stop: asyncio.Event) -> int:
    """Put `{agent}/percept/*` and `{agent}/status/*`; serve percept repair, actions, cancels and `{robot}/stop`.

    Watches the tokens of the robot's agents. When told to stop, it first leaves the robot as `on_shutdown` says.
    """
    name, clock = args.robot, Clock(args.speed or mission.speed)
    mission, manifest, steps = prepare(mission, name, args.link, clock.speed)
    async with open_bus(
        args.router or mission.router.endpoint,
        fleet=mission.fleet,
        name=name,
        daemon="bridged",
        stamp=clock.stamp,
        wire=mission.wire,
        stop=stop,
    ) as bus:
        await bus.claim(name)
        service = Service(bus, name, mission.agents_of(name), manifest)
        ledger = state_directory(args.state) / mission.fleet / f"{name}.actions"
        bridge = Bridge(
            mission, name, manifest, clock, ledger, service.publish_percept, service.publish_status, boot=bus.boot
        )
        service.open(bridge.board, bridge.desk, bridge.orders)
        work = [
            asyncio.create_task(bridge.driver.run()),
            asyncio.create_task(report_health(bus, name, clock, bridge.health)),
            asyncio.create_task(watch_agents(bus, mission.agents_of(name), bridge, steps, clock)),
        ]
        ended = asyncio.create_task(stop.wait())
        if clock.speed != 1:
            log.info("speed %g: for a simulated vehicle only", clock.speed)
        log.info("serving %s on %s for %s", name, mission.robots[name].link, ", ".join(mission.agents_of(name)))
        await asyncio.wait([ended, *work], return_when=asyncio.FIRST_COMPLETED)
        left = await bridge.orders.shut_down(mission.robots[name].on_shutdown)
        log.info("leaving %s: %s", name, left)
        return await finish([ended, *work], bridge)


async def watch_agents(bus: Bus, agents: list[str], bridge: Bridge, steps: tuple[Step, ...], clock: Clock) -> None:
    """When the agent that acted last is gone, do what the mission declares; when it is back, leave it to the agent."""
    presence, changed = Presence(agents), asyncio.Event()

    def token(key: str, alive: bool) -> None:
        if parsed := keys.parse(key):
            presence.token(parsed[1], parsed[2][-1], alive, clock.wall())
            changed.set()

    def router(up: bool) -> None:
        presence.router(up, clock.wall())
        changed.set()

    bus.on_router(router)
    for agent in agents:
        bus.watch(keys.alive(bus.fleet, agent, "agentd", "*"), token)
    lost: set[str] = set()
    while True:
        now_lost = presence.lost(clock.wall())
        for agent, why in now_lost.items():
            if agent not in lost and agent == bridge.desk.holder:
                bridge.orders.agent_lost(agent, why, steps)
        for agent in lost - set(now_lost):
            log.info("agent %s is back", agent)
            bridge.orders.call_off()
        lost = set(now_lost)
        somebody = bool(presence.known() - lost) or not bridge.driver.active
        bridge.driver.speak_for_agent(bridge.desk.holder not in lost and somebody)
        changed.clear()
        if presence.complete:
            await changed.wait()
        else:
            await asyncio.sleep(WATCH_EVERY)


async def finish(tasks: list[asyncio.Task[object]], bridge: Bridge) -> int:
    """End the daemon's tasks. Returns the exit code: 1 if one of them had failed."""
    for task in tasks:
        task.cancel()
    results = await asyncio.gather(*tasks, return_exceptions=True)
    bridge.ledger.close()
    failures = [one for one in results if isinstance(one, Exception)]
    for failure in failures:
        log.error("%s", failure)
    return EXIT_FAILED if failures else EXIT_DONE
