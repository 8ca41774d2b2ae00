"""`argosy run`: one mission on this machine, from the first process to the summary."""

from __future__ import annotations

import asyncio
import fcntl
import logging
import os
import sys
import tempfile
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Protocol, Self, TextIO

from agentd.process import loading_notice
from argosy.check.command import at_start, check_mission
from argosy.cli.errors import BadInput, CommandError, consent
from argosy.cli.journal import Entry, Journal
from argosy.cli.port_check import endpoint, in_use, link_in_use
from argosy.fleet_model.mission_clock import steady_clock
from argosy.fleet_model.model import FleetModel
from argosy.fleet_model.robots import MAX_POINTS
from argosy.processes.mavlink_links import address_of, bound_links, free_links, group_of, ports_of
from argosy.processes.process_table import Setup, free_after, places, real_robots
from argosy.processes.resource_usage import Meter
from argosy.processes.simulators import linked, only_real
from argosy.recording.run_recorder import RunRecording, recording_of
from argosy.run.end_conditions import Ending
from argosy.run.mission_runner import MissionRunner
from argosy.run.run_status import Status
from argosy.run.summary import FIGURE, summary, write_report
from bridged.drivers.registry import load_robot_manifest
from commd.common.clock import Clock
from commd.process.command_line import mission_speed
from commd.process.local_runs import announced, starting
from commd.process.process import EXIT_BAD_INPUT, EXIT_FAILED
from schemas.mission.model import Mission


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy run`."""
    parser.add_argument("mission", help="mission file")
    parser.add_argument(
        "--speed", type=mission_speed, metavar="X", help="mission seconds per wall second (simulation only)"
    )
    parser.add_argument("--plain", action="store_true", help="print lines instead of the live view")
    parser.add_argument(
        "--real",
        action="append",
        default=[],
        metavar="ROBOT",
        help="fly the real ROBOT (or `all`) instead of simulating it",
    )
    parser.add_argument("--yes", action="store_true", help="do not ask before a real robot may be armed")
    parser.add_argument(
        "--restart",
        action="store_true",
        help="restart a daemon that dies (like `restart: on-failure` in the mission)",
    )
    parser.add_argument(
        "--report",
        type=Path,
        metavar="DIR",
        help="write track.svg, mission.log, summary.txt and recording.mcap to this folder",
    )
    parser.add_argument("--record", type=Path, metavar="FILE", help="record the run to this MCAP file")
    parser.add_argument(
        "--router",
        type=endpoint,
        metavar="ENDPOINT",
        help="Zenoh endpoint of the first board's router (default: the mission's); others get the next free ports",
    )


def run(args: Namespace) -> int:
    """Run a mission. Returns the exit code: 0 only if the mission was done."""
    with loading_notice([args.mission]):
        mission, findings = check_mission(args.mission, restarts=args.restart)
    findings = at_start(findings)
    for finding in findings:
        print(finding, file=sys.stderr)
    if mission is None or any(finding.severity == "error" for finding in findings):
        return EXIT_BAD_INPUT
    with ExitStack() as stack:
        ports = stack.enter_context(ExitStack())
        wanted = args.router or mission.router.endpoint
        if not mission.router.external:
            waiting = f"waiting for another run that starts at {wanted}"
            ports.enter_context(starting(wanted, lambda: print(waiting, file=sys.stderr, flush=True)))
        setup = _setup(mission, args, Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="argosy-"))))
        recording = recording_of(args.record, args.report)
        unrecorded = "" if isinstance(recording, RunRecording) else recording
        if isinstance(recording, RunRecording):
            setup = replace(setup, recording=recording)
        _check_ports(setup)
        if setup.real and not args.yes:  # a person may take his time
            ports.close()
            consent(_consequences(setup), "nothing was started")
        if args.router is None:  # a user who names a router names it to the other commands, too
            stack.enter_context(announced(mission.fleet, setup.router))
        log = _open_log(args.report, stack)  # a run that is refused leaves an earlier report
        return _fly(setup, args, log, unrecorded, ports.close)


def _setup(mission: Mission, args: Namespace, state: Path) -> Setup:
    real, unknown = real_robots(mission, [name for names in args.real for name in names.split(",")])
    if unknown:
        known = ", ".join(mission.robots) or "none"
        raise BadInput(f"--real {unknown[0]}: there is no such robot; the mission has {known}")
    if alone := {name: why for name, why in only_real(mission).items() if name not in real}:
        name, why = next(iter(alone.items()))
        where = f"{name} on {link}" if (link := mission.robots[name].link) else name
        together = ",".join(group_of(mission, name))
        raise BadInput(f"{where}: {why}; fly the real one with --real {together}")
    mission, links = linked(mission, free_links)
    if wanted := [name for name in links if name in real]:
        raise BadInput(f"--real {wanted[0]}: the mission names no `link` to it")
    speed = args.speed if args.speed is not None else 1.0 if real else mission.speed
    if real and mission.radio is not None:
        line = mission.positions.of(("radio",))[0]
        problem = f"{', '.join(sorted(real))} is real, and `radio` is a model of the air between simulated robots"
        raise BadInput(f"{mission.path}:{line}: {problem}: take it out to fly real ones")
    if real and speed != 1:
        raise BadInput(f"--speed {speed:g}: {', '.join(sorted(real))} is real, and real time runs at speed 1")
    router = args.router or _router(mission)
    routers = places(mission, router, ports_of(mission))
    restart = args.restart or mission.restart == "on-failure"
    setup = Setup(mission, router, speed, real, state, reporting(mission), routers, restart, args.report, links=links)
    if mixed := setup.mixed():
        real_ones, others = ([one for one in mixed if (one in real) == wanted] for wanted in (True, False))
        link = mission.robots[mixed[0]].link
        problem = f"{', '.join(real_ones)} is real, and {', '.join(others)} on the same link {link} would be simulated"
        raise BadInput(f"{problem}: fly all of them with --real {','.join(mixed)}")
    return setup


def _router(mission: Mission) -> str:
    """Return the first board's router: the mission's; of one that names none the next free port. Raises NoPort."""
    if mission.names_router or not in_use(mission.router.endpoint):
        return mission.router.endpoint
    return next(free_after(mission.router.endpoint, ports_of(mission)))


def _check_ports(setup: Setup) -> None:
    """Check that router and links are free before anything starts: two runs must not share a link."""
    mission = setup.mission
    if mission.router.external is False and (why := in_use(setup.router)):
        other = "another one, such as --router tcp/127.0.0.1:7448, and give the robots other links"
        raise CommandError(f"{setup.router} {why}: is another mission running? Name {other}")
    for link, robots in bound_links(mission, setup.simulators()).items():
        line = mission.positions.of(("robots", robots[-1], "link"))[0]
        boards = list(dict.fromkeys(mission.robots[robot].board for robot in robots))
        if len(boards) > 1:
            problem = f"{link} is a link of {' and of '.join(boards)}, and here they are one machine"
            raise BadInput(f"{mission.path}:{line}: {problem}: give {robots[-1]} another one")
        if link.port and (why := link_in_use(link)):
            advice = f"is another mission running? Give {', '.join(robots)} another link"
            raise CommandError(f"{mission.path}:{line}: {link} {why}: {advice}")


def reporting(mission: Mission) -> frozenset[str]:
    """Return the robots whose manifest has the percept `state(Mode, Connected, Armed)`."""
    manifests = {
        name: load_robot_manifest(robot.manifest, mission.path.parent) for name, robot in mission.robots.items()
    }
    return frozenset(name for name, manifest in manifests.items() if manifest.percept_arities().get("state") == 3)


def _open_log(report: Path | None, stack: ExitStack) -> TextIO | None:
    if report is None:
        return None
    try:
        report.mkdir(parents=True, exist_ok=True)
        log = stack.enter_context((report / "mission.log").open("a", encoding="utf-8"))
        fcntl.flock(log, fcntl.LOCK_EX | fcntl.LOCK_NB)
        log.truncate(0)
        return log
    except BlockingIOError:
        raise BadInput(f"--report {report}: another run writes its report there") from None
    except OSError as error:
        raise BadInput(f"--report {report}: {error.strerror}") from None


def _consequences(setup: Setup) -> str:
    """Return what happens to the real robots, as text: those with a MAVLink link may be armed."""
    vehicles = sorted(name for name in setup.real if address_of(setup.mission.robots[name]) is not None)
    actions = (
        ("arm and fly the real vehicle", vehicles),
        ("act on the real robot", sorted({*setup.real} - {*vehicles})),
    )
    parts = [f"{action}{'s' if len(names) > 1 else ''} {', '.join(names)}" for action, names in actions if names]
    return " and ".join(parts)


def _fly(setup: Setup, args: Namespace, log: TextIO | None, unrecorded: str, bound: Callable[[], None]) -> int:
    clock = Clock(setup.speed)
    journal = Journal(clock.now, log)
    model = FleetModel(steady_clock, mission=setup.mission, track_points=MAX_POINTS, sees_runs=False)
    status = Status(setup, model, journal, Meter(), [], clock.now, recorded=unrecorded)
    logging.basicConfig(handlers=[_JournalHandler(journal)], level=logging.WARNING, force=True)
    flight = MissionRunner(status, bound)
    with _view(status, args.plain) as view:
        journal.shown = view.show
        ending = asyncio.run(flight.fly(view.refresh))
    return _print_ending(flight, ending, args.report)


def _print_ending(flight: MissionRunner, ending: Ending, report: Path | None) -> int:
    text = summary(flight.status, ending, flight.phases())
    with suppress(OSError):
        print(f"\n{text}", end="", flush=True)
    if report is not None:
        try:
            recording = flight.status.setup.recording
            without = write_report(report, None if recording is None else recording.path, text)
        except OSError as error:
            print(f"error: --report {report}: {error.strerror}", file=sys.stderr)
            return ending.code or EXIT_FAILED
        if without:
            print(f"note: no {FIGURE}: {without}", file=sys.stderr)
    if ending.code:
        with suppress(OSError):
            print(f"error: {ending.text}", file=sys.stderr)
    return ending.code


class _View(Protocol):
    """A view of a run."""

    def __enter__(self) -> Self: ...
    def __exit__(self, *_: object) -> None: ...
    def show(self, entry: Entry) -> None:
        """Take an entry of the journal."""

    def refresh(self) -> None:
        """Draw what is known now."""


def _view(status: Status, plain: bool) -> _View:
    if plain or not sys.stdout.isatty() or os.environ.get("TERM", "") in ("", "dumb", "unknown"):
        return PlainView(sys.stdout)
    from rich.console import Console

    from argosy.run.screen import LiveView

    return LiveView(status, Console())


class _JournalHandler(logging.Handler):
    """Shows log lines of our own bus in the view, not across it."""

    def __init__(self, journal: Journal) -> None:
        super().__init__(logging.WARNING)
        self._journal = journal

    def emit(self, record: logging.LogRecord) -> None:
        self._journal.add("argosy", record.getMessage(), "warning")


class PlainView:
    """Writes each entry of the journal as one line."""

    def __init__(self, out: TextIO) -> None:
        self._out = out

    def __enter__(self) -> PlainView:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def show(self, entry: Entry) -> None:
        """Write one line."""
        try:
            print(entry, file=self._out, flush=True)
        except OSError:  # the reader is gone; vehicles still have to be brought home
            self.show = lambda entry: None  # type: ignore[method-assign]

    def refresh(self) -> None:
        """Do nothing: lines are written as they come."""
