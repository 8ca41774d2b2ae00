"""The bridge daemon: binds robots to their agents."""

from __future__ import annotations

import asyncio
import logging
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import Any

from bridged.bridge.agent_monitor import watch_agents
from bridged.bridge.bridge import Bridge
from bridged.bridge.bus_endpoints import Service
from bridged.bridge.robot_setup import RobotSetup, chosen, prepare_all
from bridged.bridge.two_bridges import run_alone
from commd.bus.bus import Bus, open_bus
from commd.common.clock import Clock
from commd.process.command_line import mission_speed
from commd.process.garbage import look_seldom
from commd.process.process import EXIT_DONE, EXIT_FAILED, add_router_argument, greet, report_health, run_daemon, tls_of
from commd.process.restart_counter import note_start
from commd.process.state_dir import state_directory
from commd.process.systemd import Member, Unit
from schemas.files.findings import Findings
from schemas.files.text_files import MAY_PASS
from schemas.liveness import HEALTH_EVERY
from schemas.mission.model import Mission, load_mission
from schemas.wire import keys
from schemas.wire.log_lines import RobotLeft

log = logging.getLogger("bridged")


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `bridged serve`."""
    parser.add_argument("mission", help="mission file")
    parser.add_argument("robots", nargs="*", metavar="ROBOT", help="robots to serve (default: all of the board)")
    parser.add_argument("--board", help="board whose robots to serve")
    add_router_argument(parser)
    parser.add_argument(
        "--speed",
        type=mission_speed,
        metavar="X",
        help="mission seconds per wall second (default: the mission's; simulation only)",
    )
    parser.add_argument("--state", type=Path, metavar="DIR", help="folder of the action log")
    text = "folder of logs downloaded from vehicles (default: logs, beside the action log)"
    parser.add_argument("--logs", type=Path, metavar="DIR", help=text)
    parser.add_argument("--link", help="link to the robots (default: the mission's)")
    parser.add_argument(
        "--until-home",
        action="store_true",
        help="on SIGTERM, stay until the robots are disarmed, at most `bring_home` of the mission",
    )
    parser.add_argument("--simulated", action="store_true", help="use the simulated twins of the robots")


def run(args: Namespace) -> int:
    """Run the daemon until SIGTERM or SIGINT. Returns the exit code."""

    async def main(stop: asyncio.Event) -> int:
        look_seldom()
        return await serve(load_mission(args.mission), args, stop)

    return run_daemon("bridged", main)


async def serve(mission: Mission, args: Namespace, stop: asyncio.Event, unit: Member | None = None) -> int:
    """Put `{agent}/percepts` and `{agent}/status/*`; serve percept repair, actions, cancels and `{robot}/stop`.

    Watches the tokens of each robot's agents. Once `stop` is set, it first leaves each robot as `on_shutdown` says, and
    with `until_home` stays with it until it is disarmed.
    """
    clock = Clock(args.speed or mission.speed)
    unit = unit or Unit().member("bridged")
    mission, parts = prepare_all(mission, chosen(mission, args.robots, args.board), args.link, clock.speed)
    endpoint = args.router or mission.router.endpoint
    unit.status(f"waiting for the router at {endpoint}")
    async with open_bus(
        endpoint,
        fleet=mission.fleet,
        name=parts[0].name,
        daemon="bridged",
        wire=mission.wire,
        stop=stop,
        tls=tls_of(args),
    ) as bus:
        await greet(bus, (mission.robots[part.name].board for part in parts))
        shared: dict[str, Any] = {}
        bound = [await bind(bus, mission, part, clock, args, shared, unit) for part in parts]
        bridges = [bridge for bridge, _ in bound]
        await bus.permitted(puts=[key for part in parts for key in published_keys(bus, part)])
        folder = state_directory(args.state) / mission.fleet
        bus.restarts, bus.former_failure = note_start(folder, "bridged", parts[0].name)
        for bridge in bridges:
            bridge.driver.alone = len(bridges) == 1
        work = [asyncio.create_task(run_alone(bus, bridge, service, clock)) for bridge, service in bound]
        for part, (bridge, service) in zip(parts, bound, strict=True):
            work.append(asyncio.create_task(report_health(bus, part.name, clock, service.health)))
            work.append(asyncio.create_task(watch_agents(bus, mission, part, bridge, clock)))
            log.info("serving %s on %s for %s", part.name, part.where, ", ".join(part.agents))
        unit.ready(status_line(bridges, bus))
        work.append(asyncio.create_task(report_status(unit, bridges, bus)))
        ended = asyncio.create_task(stop.wait())
        if clock.speed != 1:
            log.info("speed %g: for simulated vehicles only", clock.speed)
        await asyncio.wait([ended, *work], return_when=asyncio.FIRST_COMPLETED)
        unit.stopping(f"leaving {', '.join(bridge.name for bridge in bridges)} as on_shutdown says")
        stay = float(mission.bring_home) if args.until_home else 0.0
        stop.clear()  # at a second signal it leaves
        await asyncio.gather(*(leave(bridge, mission, stay, stop) for bridge in bridges))
        return await finish([ended, *work], bridges)


async def bind(
    bus: Bus, mission: Mission, part: RobotSetup, clock: Clock, args: Namespace, shared: dict[str, Any], unit: Member
) -> tuple[Bridge, Service]:
    """Claim a robot's name and begin to serve its agents. Raises AlreadyRunning, Findings or OSError."""
    await bus.claim(part.name)
    service = Service(bus, part.name, part.agents, mission.inject)
    action_log = state_directory(args.state) / mission.fleet / f"{part.name}.actions"
    try:
        bridge = Bridge(
            mission,
            part.name,
            part.manifest,
            clock,
            action_log,
            service.publish_percept,
            service.publish_status,
            boot=bus.boot,
            bus=bus,
            simulated=args.simulated,
            shared=shared,
            loop=unit.loop(),
            logs=args.logs,
        )
    except (ValueError, OSError) as error:
        if isinstance(error, OSError) and error.errno in MAY_PASS:  # no input is bad: a later start may succeed
            raise
        why = f"{error.filename}: {error.strerror}" if isinstance(error, OSError) and error.filename else str(error)
        problem = f"robot {part.name} cannot be served: {why}"
        raise Findings([mission.positions.finding(("robots", part.name), problem)]) from error
    service.open(bridge)
    bridge.orders.restore()
    return bridge, service


def published_keys(bus: Bus, part: RobotSetup) -> list[str]:
    """Return the keys on which a bridge publishes for a robot."""
    of_agents = [build(bus.fleet, agent, "any") for agent in part.agents for build in (keys.percept, keys.status)]
    together = [keys.percepts(bus.fleet, agent) for agent in part.agents]
    return [*together, *of_agents, keys.health(bus.fleet, part.name, bus.daemon), keys.manifest(bus.fleet, part.name)]


def status_line(bridges: list[Bridge], bus: Bus) -> str:
    """Return what the bridges do and their warnings, as a line for the service manager."""
    away = "" if bus.router_up else "; the router is lost"
    notes = "".join(f"; {bridge.name}: {note.text}" for bridge in bridges for note in bridge.notes())
    return f"serving {', '.join(bridge.name for bridge in bridges)}{away}{notes}"


async def report_status(unit: Member, bridges: list[Bridge], bus: Bus) -> None:
    """Report to the service manager for ever."""
    loop = unit.loop()
    while True:
        loop.beat()
        await asyncio.sleep(min(HEALTH_EVERY, loop.period or HEALTH_EVERY))
        unit.status(status_line(bridges, bus))


async def leave(bridge: Bridge, mission: Mission, stay: float, ending_again: asyncio.Event) -> None:
    """Leave a robot as the mission's `on_shutdown` says, within `stay` mission seconds, and log how."""
    try:
        left = await bridge.orders.shut_down(mission.robots[bridge.name].on_shutdown, stay, ending_again)
    except Exception as error:  # one robot's defect must not keep the others from their way home
        asyncio.get_running_loop().call_exception_handler({"message": f"leaving {bridge.name}", "exception": error})
        left = RobotLeft(robot=bridge.name, state="unconfirmed", text="unknown because of a defect")
    log.info("leaving %s: %s", left.robot, left.text, extra={"event": left})


async def finish(tasks: list[asyncio.Task[Any]], bridges: list[Bridge]) -> int:
    """End the daemon's tasks. Returns the exit code: 1 if one of them had failed."""
    for task in tasks:
        task.cancel()
    results = await asyncio.gather(*tasks, return_exceptions=True)
    for bridge in bridges:
        bridge.action_log.close()
    failures = [one for one in results if isinstance(one, Exception)]
    for failure in _leaves(failures):
        log.error("%s", failure)
    return EXIT_FAILED if failures else EXIT_DONE


def _leaves(failures: list[Exception]) -> list[Exception]:
    """The single errors in groups of them."""
    found: list[Exception] = []
    for failure in failures:
        found += _leaves(list(failure.exceptions)) if isinstance(failure, ExceptionGroup) else [failure]
    return found
