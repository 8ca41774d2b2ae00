"""The comm daemon: a board's Zenoh router, its directory, and the mail of its agents."""

from __future__ import annotations

import asyncio
import logging
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Coroutine, Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import zenoh

from commd.bus.bus import Bus, Query, open_bus
from commd.bus.router_endpoints import router_of
from commd.bus.tls import Tls, check_board
from commd.common.clock import Clock
from commd.directory.service import open_directory
from commd.mail.service import open_mail_service
from commd.process.garbage import look_seldom
from commd.process.process import (
    EXIT_DONE,
    EXIT_FAILED,
    add_router_argument,
    endpoint_argument,
    report_health,
    run_daemon,
    tls_of,
)
from commd.process.restart_counter import note_start
from commd.process.state_dir import state_directory
from commd.process.systemd import Loop, Member, Unit
from commd.router import config as router_config
from commd.router.admission import Admission, open_admission
from commd.router.link_monitor import Links
from commd.router.link_watchdog import LinkWatchdog
from commd.router.self_check import SelfCheck
from commd.router.tls_rejections import hear_refusals
from schemas.files.findings import Findings, did_you_mean
from schemas.mission.model import Mission, load_mission
from schemas.wire import keys
from schemas.wire.records import Health, Note, RunningMission

ROUND_TRIP = 2.0
"""Wall seconds within which the router must answer itself; after that it counts as hung."""
NO_RULES = Note(
    "no_access_rules",
    "no access rules: everybody with a certificate of the fleet may do everything here; "
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
    """Run the daemon until SIGTERM or SIGINT. Returns the exit code."""
    if args.keys is not None or args.config is not None:
        hear_refusals()

    async def main(stop: asyncio.Event) -> int:
        look_seldom()
        return await serve(load_mission(args.mission), args, stop)

    return run_daemon("commd", main)


def chosen(mission: Mission, asked: str | None) -> str:
    """Return this board. Raises Findings if the mission does not have it, or has several and none was named."""
    boards = mission.board_names
    if asked is None and len(boards) > 1:
        text = f"which board is this? Name it by --board: the mission has {', '.join(boards)}"
        raise Findings.about(mission.path, text)
    if asked is not None and asked not in boards:
        raise Findings.about(mission.path, f"no board `{asked}`{did_you_mean(asked, boards)}")
    return asked or boards[0]


@dataclass(frozen=True)
class RouterSetup:
    """How the board's router is opened, by the mission, the command line and `--config`."""

    mode: Literal["client", "router"]
    """`client`: of a router that somebody else runs."""
    endpoint: str
    listen: Sequence[str]
    connect: Sequence[str]
    tls: Tls | None
    config: zenoh.Config | None
    secured: bool
    """Whether routers enforce access rules."""
    most_links: int | None
    admission: Admission | None
    """Judges the connections of other machines, if they connect by TLS."""


def router_setup(mission: Mission, board: str, args: Namespace) -> RouterSetup:
    """Return how to open the router of a board. Raises Findings for a bad `--config` or bad keys."""
    given = router_config.read(args.config) if args.config is not None else None
    mode: Literal["client", "router"] = "client" if mission.router.external and given is None else "router"
    endpoint, tls = args.router or mission.router.endpoint, tls_of(args)
    listen, connect = args.listen, args.connect
    if given is not None:
        (endpoint, *listen), tls = given.listen, given.tls
    elif not (listen or connect) and mode == "router":
        listen, connect = router_of(mission, board, endpoint, "tls" if tls is not None else "tcp")
    if tls is not None:
        check_board(tls, mission, board)
    config = given.config if given is not None else None
    admission: Admission | None = None
    if tls is not None and mode == "router" and (public := [one for one in listen if one.startswith("tls/")]):
        admission = Admission(public, mission)
        listen = [*(one for one in listen if one not in public), *admission.inner]
        if config is not None:
            router_config.set_endpoints(config, endpoint, listen)
    secured = given is not None and given.secured
    most_links = given.most_links if given is not None else None
    return RouterSetup(mode, endpoint, listen, connect, tls, config, secured, most_links, admission)


class Parts:
    """The running parts of the daemon: their health, and the tasks that must not end."""

    def __init__(self, stack: AsyncExitStack) -> None:
        """The tasks are cancelled when `stack` ends."""
        self._stack = stack
        self.health: list[Callable[[], Health]] = []
        self.work: dict[asyncio.Task[None], str] = {}
        """What each task does, for the log."""

    def add(self, name: str, health: Callable[[], Health], *work: Coroutine[Any, Any, None]) -> None:
        """Add a part, and run what it does for ever."""
        self.health.append(health)
        for each in work:
            task = asyncio.create_task(each)
            self._stack.callback(task.cancel)
            self.work[task] = name


async def serve(mission: Mission, args: Namespace, stop: asyncio.Event, unit: Member | None = None) -> int:
    """Route for the board, serve its directory, and deliver the mail of its agents. Returns the exit code."""
    clock, board = Clock(), chosen(mission, args.board)
    unit = unit or Unit().member("commd")
    router = router_setup(mission, board, args)
    async with (
        open_bus(
            router.endpoint,
            fleet=mission.fleet,
            name=board,
            daemon="commd",
            wire=mission.wire,
            mode=router.mode,
            listen=router.listen,
            connect=router.connect,
            stop=stop,
            tls=router.tls,
            config=router.config,
        ) as bus,
        AsyncExitStack() as stack,
    ):
        await bus.claim(board)
        folder = state_directory(args.state) / mission.fleet
        bus.restarts, bus.former_failure = note_start(folder, "commd", board)
        parts = await open_parts(stack, bus, mission, board, router, folder, clock)
        SelfCheck(bus, board, mission.board_names, folder)
        publish_mission(bus, board, mission)
        log.info("%s board=%s endpoint=%s", router.mode, board, router.endpoint)
        unit.ready(words := f"{router.mode} of {board} at {router.endpoint}")

        def details() -> Health:
            found = together(parts.health)
            unit.status(words, *(note.text for note in found.notes))
            return found

        health = asyncio.create_task(report_health(bus, board, clock, details))
        turning = asyncio.create_task(turn(bus, unit.loop()))
        stopping = asyncio.create_task(stop.wait())
        work = {health: "the router", turning: "the watch over the router", **parts.work}
        await asyncio.wait((*work, stopping), return_when=asyncio.FIRST_COMPLETED)
        broken = [task for task in work if task.done()]
        for task in broken:
            error = task.exception() if not task.cancelled() else "cancelled"
            log.error("%s is broken, commd is to be started again: %r", work[task], error)
        unit.stopping()
        for each in (health, turning, stopping):
            each.cancel()
    return EXIT_FAILED if broken else EXIT_DONE


async def open_parts(
    stack: AsyncExitStack, bus: Bus, mission: Mission, board: str, router: RouterSetup, folder: Path, clock: Clock
) -> Parts:
    """Open the parts that the mission and the router need, until `stack` ends."""
    parts, enter = Parts(stack), stack.enter_async_context
    # The gateway and the radio are imported only if needed: few missions have them, and they take memory.
    air = gateway = None
    if mission.radio is not None:
        from commd.gateway.radio_model import RadioAir

        air = RadioAir(bus, mission, mission.radio, board)
        parts.add("the radio", air.health, air.run())
    if mission.gateway is not None and mission.gateway.board == board:
        from commd.gateway.gateway import open_gateway

        gateway = await enter(open_gateway(mission, mission.gateway))
    carries = air.carries if air is not None else None
    mail_service = await enter(
        open_mail_service(bus, mission.mailboxes, mission.mail, folder, carries, everybody_known=False)
    )
    parts.add("the mail", mail_service.health)
    directory = await enter(open_directory(bus, board, mission, mail_service, clock, router.secured))
    parts.add("the directory", directory.health, directory.run())
    if gateway is not None:
        parts.add("the gateway", gateway.health, gateway.run(mail_service))
    if router.admission is not None:
        await enter(open_admission(router.admission, bus))
        parts.add("admission", router.admission.health)
    if router.mode == "router":
        if router.tls is not None:
            links = Links(bus, mission, board, router.tls, most=router.most_links)
            parts.add("the links", links.health, links.watch())
        others = [other for other in mission.boards if other != board]
        watchdog = LinkWatchdog(bus, others, [router.endpoint, *router.listen])
        parts.add("the watch over the links", watchdog.health, watchdog.run())
    if router.tls is not None and not router.secured:
        log.warning("%s", NO_RULES.text)
        parts.add("no rules", lambda: Health(notes=(NO_RULES,)))
    return parts


def publish_mission(bus: Bus, board: str, mission: Mission) -> None:
    """Serve the mission file as it was read at the start, so that observers know what runs."""
    key = keys.mission(mission.fleet, board)

    def answer(query: Query[RunningMission]) -> None:
        query.reply(RunningMission(header=bus.header("mission"), file=mission.path.name, text=mission.text), key)

    bus.serve(key, RunningMission, answer)


async def turn(bus: Bus, loop: Loop) -> None:
    """Feed the watchdog while the router answers, or while a router that somebody else runs is away; for ever."""
    while loop.period is not None:
        if not bus.router_up or await bus.round_trip(ROUND_TRIP):
            loop.beat()
        else:
            log.error("the router does not answer within %g s", ROUND_TRIP)
        await asyncio.sleep(loop.period)
    await asyncio.Event().wait()


def together(parts: Sequence[Callable[[], Health]]) -> Health:
    """Return the health of a daemon's parts as one record."""
    healths = [part() for part in parts]
    counters = {name: count for health in healths for name, count in health.counters.items()}
    return Health(
        drops=sum(health.drops for health in healths),
        bad_input=sum(health.bad_input for health in healths),
        counters=counters,
        notes=tuple(note for health in healths for note in health.notes),
    )
