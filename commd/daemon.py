"""The comm daemon: the board's Zenoh router, and the mail between the agents of the board."""

from __future__ import annotations

import asyncio
import logging
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Sequence
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Literal

from commd.bus.bus import Bus, Query, open_bus
from commd.bus.router_endpoints import router_of
from commd.bus.tls import check_board
from commd.common.clock import Clock
from commd.directory.service import open_directory
from commd.mail.service import open_mailroom
from commd.mail.transport import FixedDirectory
from commd.process.process import (
    EXIT_DONE,
    EXIT_FAILED,
    add_router_argument,
    endpoint_argument,
    report_health,
    run_daemon,
    tls_of,
)
from commd.process.restart_counter import begin_life
from commd.process.state_dir import state_directory
from commd.process.systemd import Loop, Member, Unit
from commd.router import config as router_config
from commd.router.admission import Admission, open_admission
from commd.router.link_monitor import open_links
from commd.router.link_watchdog import open_link_watchdog
from commd.router.self_check import SelfCheck
from commd.router.tls_rejections import hear_refusals
from schemas.files.findings import Finding, Findings, did_you_mean
from schemas.mission.model import Mission, load_mission
from schemas.wire import keys
from schemas.wire.records import Health, Note, RunningMission

ROUND_TRIP = 2.0
"""Wall seconds within which the router answers itself, or hangs."""
NO_RULES = Note(
    "no_access_rules",
    "no access rules: whoever has a certificate of the fleet may do everything here; "
    "`argosy units` writes rules, --config FILE takes them",
)
log = logging.getLogger("commd")


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `commd serve`."""
    parser.add_argument("mission", help="mission file")
    parser.add_argument("--board", help="board to serve (default: the only one)")
    parser.add_argument("--state", type=Path, metavar="DIR", help="folder of the mail, below the fleet's name")
    add_router_argument(parser)
    text = "configuration of the router, as `argosy units` writes it; replaces every other setting of the router"
    parser.add_argument("--config", type=Path, metavar="FILE", help=text)
    for option, what in (("--listen", "endpoint for other boards' routers"), ("--connect", "a router to dial")):
        text = f"{what}; repeatable; either replaces the mission's addresses"
        parser.add_argument(option, metavar="ENDPOINT", type=endpoint_argument, action="append", default=[], help=text)


def run(args: Namespace) -> int:
    """Run the daemon until it is told to stop. Returns the exit code."""
    if args.keys is not None or args.config is not None:
        hear_refusals()
    return run_daemon("commd", lambda stop: serve(load_mission(args.mission), args, stop))


def chosen(mission: Mission, asked: str | None) -> str:
    """Return the board that this is. Raises Findings for one that the mission has not, or if it has to be said."""
    boards = mission.board_names
    if asked is None and len(boards) > 1:
        text = f"which board is this? Say it by --board: the mission has {', '.join(boards)}"
        raise Findings([Finding(str(mission.path), 0, 0, text)])
    if asked is not None and asked not in boards:
        raise Findings([Finding(str(mission.path), 0, 0, f"no board `{asked}`{did_you_mean(asked, mission.boards)}")])
    return asked or boards[0]


async def serve(mission: Mission, args: Namespace, stop: asyncio.Event, unit: Member | None = None) -> int:
    """Route for the board; keep its directory, and its mail: from `{agent}/outbox` or other boards to its agents."""
    clock = Clock()
    unit = unit or Unit.of_environment().member("commd")
    board = chosen(mission, args.board)
    endpoint = args.router or mission.router.endpoint
    tls = tls_of(args)
    listen, connect = args.listen, args.connect
    given = router_config.read(args.config) if args.config is not None else None
    external = mission.router.external and given is None
    if given is not None:
        endpoint, *listen = given.listen
        tls = given.tls
    elif not (listen or connect) and not external:
        listen, connect = router_of(mission, board, endpoint, "tls" if tls is not None else "tcp")
    if tls is not None:
        check_board(tls, mission, board)
    secured = given is not None and given.secured
    config = given.config if given is not None else None
    admission: Admission | None = None
    if tls is not None and not external and (public := [one for one in listen if one.startswith("tls/")]):
        admission = Admission(public, mission)
        listen = [*(one for one in listen if one not in public), *admission.inner]
        if config is not None:
            router_config.listen_at(config, endpoint, listen)
    open_to_its_machines = tls is not None and not secured
    if open_to_its_machines:
        log.warning("%s", NO_RULES.text)
    mode: Literal["client", "router"] = "client" if external else "router"
    async with open_bus(
        endpoint,
        fleet=mission.fleet,
        name=board,
        daemon="commd",
        stamp=clock.stamp,
        wire=mission.wire,
        mode=mode,
        listen=listen,
        connect=connect,
        stop=stop,
        tls=tls,
        config=config,
    ) as bus:
        await bus.claim(board)
        known = FixedDirectory(mission.mailboxes)
        folder = state_directory(args.state) / mission.fleet
        bus.restarts, bus.former_failure = begin_life(folder, "commd", board)
        async with AsyncExitStack() as parts_of:
            enter = parts_of.enter_async_context
            # What few missions have is loaded for those: it takes memory on each board.
            air = gateway = None
            if mission.radio is not None:
                from commd.gateway.radio_model import open_air

                air = await enter(open_air(bus, mission, board))
            if mission.gateway is not None and mission.gateway.board == board:
                from commd.gateway.gateway import open_gateway

                gateway = await enter(open_gateway(mission, board))
            mail_service = await enter(open_mailroom(bus, known, mission.mail, folder, air, everybody_known=False))
            directory = await enter(open_directory(bus, board, mission, mail_service, clock, secured))
            if gateway is not None:
                await enter(gateway.serving(mail_service))
            SelfCheck(bus, board, mission.board_names, folder)
            tell_mission(bus, board, mission)
            if admission is not None:
                await enter(open_admission(admission, bus))
            links = None
            if tls is not None and mode == "router":
                most_links = given.most_links if given is not None else None
                links = await enter(open_links(bus, mission, board, tls, most_links))
            watchdog = None
            if mode == "router":
                others = [other for other in mission.boards if other != board]
                watchdog = await enter(open_link_watchdog(bus, others))
            further = (gateway, air, links, watchdog, admission)
            parts = [mail_service.health, directory.health, *(part.health for part in further if part is not None)]
            if open_to_its_machines:
                parts.append(lambda: Health(notes=(NO_RULES,)))
            log.info("%s board=%s endpoint=%s", mode, board, endpoint)
            unit.ready(words := f"{mode} of {board} at {endpoint}")

            def details() -> Health:
                found = together(parts)
                unit.status(words, *(note.text for note in found.notes))
                return found

            health = asyncio.create_task(report_health(bus, board, clock, details))
            turning = asyncio.create_task(turn(bus, unit.loop()))
            stopping = asyncio.create_task(stop.wait())
            work: dict[asyncio.Task[None], str] = {health: "the router", turning: "the watch over the router"}
            work |= dict.fromkeys(directory.work, "the directory")
            work |= dict.fromkeys([watchdog.running] if watchdog is not None else (), "the watch over the links")
            work |= dict.fromkeys(gateway.work if gateway is not None else (), "the gateway")
            work |= dict.fromkeys(air.work if air is not None else (), "the radio")
            await asyncio.wait((*work, stopping), return_when=asyncio.FIRST_COMPLETED)
            broken = [task for task in work if task.done()]
            for task in broken:
                error = task.exception() if not task.cancelled() else "cancelled"
                log.error("%s is broken, commd is to be started again: %r", work[task], error)
            unit.stopping()
            health.cancel()
            turning.cancel()
            stopping.cancel()
    return EXIT_FAILED if broken else EXIT_DONE


def tell_mission(bus: Bus, board: str, mission: Mission) -> None:
    """Serve the mission file as it was read, so that whoever looks on knows what runs, not what a file says by now."""
    key = keys.mission(mission.fleet, board)

    def answer(query: Query[RunningMission]) -> None:
        query.reply(RunningMission(header=bus.header("mission"), file=mission.path.name, text=mission.text), key)

    bus.serve(key, RunningMission, answer, at_once=True)


async def turn(bus: Bus, loop: Loop) -> None:
    """Say for ever that this loop turns and the router answers; one that somebody else runs and that is away may."""
    while loop.period is not None:
        if not bus.router_up or await bus.round_trip(ROUND_TRIP):
            loop.beat()
        else:
            log.error("the router does not answer within %g s", ROUND_TRIP)
        await asyncio.sleep(loop.period)
    await asyncio.Event().wait()


def together(parts: Sequence[Callable[[], Health]]) -> Health:
    """Return the health of the parts of a daemon as that of the whole."""
    healths = [part() for part in parts]
    counters = {name: count for health in healths for name, count in health.counters.items()}
    return Health(
        drops=sum(health.drops for health in healths),
        bad_input=sum(health.bad_input for health in healths),
        counters=counters,
        notes=tuple(note for health in healths for note in health.notes),
    )
