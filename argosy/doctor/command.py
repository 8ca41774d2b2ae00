"""`argosy doctor`: inspect a fleet from the operator's machine; each finding says what to do."""

from __future__ import annotations

import asyncio
import json
import logging
import shutil
import sys
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from textwrap import wrap
from typing import Any

from argosy.cli.errors import BadInput
from argosy.cli.operator_bus import Where, add_mission_argument, add_router_argument, operator_bus, where
from argosy.cli.remedies import target_of
from argosy.doctor.findings import Check, Diagnosis, Facts, RobotFacts
from argosy.doctor.fleet_checks import clocks, daemons, disks, failsafes, links, mail, percepts, vehicles, versions
from argosy.doctor.security_checks import certificates
from argosy.doctor.security_checks import findings as access
from argosy.fleet_model.fleet_status import FleetStatus
from commd.bus.bus import Bus
from commd.bus.errors import BusClosed, BusError, QueryFailed
from commd.process.process import EXIT_DONE, EXIT_FAILED
from commd.router.self_check import LINKS_WITHIN, measure_all
from schemas.files.findings import Findings
from schemas.humanize import count, printable
from schemas.liveness import SILENT_AFTER
from schemas.manifest.loader import load_manifest
from schemas.mission.model import Mission, load_mission
from schemas.wire import keys
from schemas.wire.records import BoardReport, Checkup, LiveManifest, Mailboxes, Perception

CHECKS: tuple[Check, ...] = (daemons, versions, clocks, disks, links, vehicles, failsafes, percepts, mail)
WATCHED = 3.0
"""Wall seconds over which rates are measured."""
ANSWER_TIMEOUT = 3.0
"""Wall seconds for a bridge or a mailbox to answer."""
STYLES = {"ok": "\x1b[32m", "warning": "\x1b[33m", "error": "\x1b[1;31m"}


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy doctor`."""
    add_mission_argument(parser, "mission file")
    add_router_argument(parser, "the mission's")
    parser.add_argument("--json", action="store_true", help="as JSON")
    parser.set_defaults(fleet=None)


def run(args: Namespace) -> int:
    """Print the findings. Returns 1 if one is an error, else 0."""
    if args.mission is None:
        raise BadInput("argosy doctor: expected a MISSION")
    mission, place = load_mission(args.mission), where(args)
    diagnoses = certificates(mission, args.keys)
    try:
        with _quiet():
            diagnoses += asyncio.run(examine(mission, place))
    except BusClosed as closed:
        do = f"is the fleet there? {target_of(mission, 'start', 'its boards')}; or name another router by --router"
        diagnoses.append(Diagnosis("error", "router", str(closed), do))
    show(diagnoses, as_json=args.json)
    return EXIT_FAILED if any(one.level == "error" for one in diagnoses) else EXIT_DONE


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence warnings of the sessions: unreached boards are among the findings."""
    log = logging.getLogger("bus")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        yield
    finally:
        log.setLevel(level)


async def examine(mission: Mission, place: Where) -> list[Diagnosis]:
    """Gather the facts and run all checks. Raises BusClosed."""
    async with operator_bus(place) as bus:
        facts = await gather(bus, mission)
        diagnoses = [one for check in CHECKS for one in check(facts)]
        return diagnoses + await access(bus, mission)


async def gather(bus: Bus, mission: Mission) -> Facts:
    """Query all daemons, each with a timeout; a missing answer is a fact, too."""
    loop = asyncio.get_running_loop()
    fleet_status = FleetStatus.of_bus(bus, bus.fleet, mission)
    await fleet_status.settle(SILENT_AFTER + 0.5)
    earlier, began = fleet_status.rows(), loop.time()
    boards: dict[str, BoardReport | str] = {}
    for board in mission.board_names:
        key, within = keys.checkup(bus.fleet, board), LINKS_WITHIN + ANSWER_TIMEOUT
        try:
            boards[board] = await bus.ask_one(key, Checkup(links=True), BoardReport, within)
        except BusError as error:
            boards[board] = str(error)
    reached = [board for board, report in boards.items() if isinstance(report, BoardReport)]
    from_here = await measure_all(bus, reached)
    there = {row.name for row in fleet_status.rows() if row.daemon == "bridged" and row.well}
    now, robots = time.time_ns(), {}
    for robot in mission.robots:
        if robot in there and mission.agents_of(robot):
            now, robots[robot] = time.time_ns(), await _robot(bus, mission, robot)
    boxes: dict[str, Mailboxes] = {}
    key = keys.mailboxes(bus.fleet, "*")
    await bus.ask_all(key, Mailboxes, ANSWER_TIMEOUT, lambda _, mail: boxes.__setitem__(mail.board, mail))
    await asyncio.sleep(max(0.0, began + WATCHED - loop.time()))
    links_by_board = {link.board: link for link in from_here}
    return Facts(mission, fleet_status.rows(), earlier, boards, links_by_board, robots, boxes, now)


async def _robot(bus: Bus, mission: Mission, robot: str) -> RobotFacts:
    agent = mission.agents_of(robot)[0]
    percepts: dict[str, int] = {}

    def note(_: str, percept: Perception) -> None:
        percepts[percept.name] = max(percepts.get(percept.name, 0), percept.header.stamp)

    declared: dict[str, Any] | None
    try:
        await bus.ask_all(keys.percept(bus.fleet, agent, "**"), Perception, ANSWER_TIMEOUT, note)
        answer = await bus.ask_one(keys.manifest(bus.fleet, robot), None, LiveManifest, ANSWER_TIMEOUT)
        own = answer.manifest.get("robot", {}).get("driver", "")
        declared = {name: {"driver": own} | entry for name, entry in answer.manifest.get("percepts", {}).items()}
    except BusClosed as closed:
        return RobotFacts(percepts, {}, str(closed))
    except QueryFailed:
        declared = _of_the_file(mission, robot)
    if declared is None:
        return RobotFacts(percepts, {}, "its bridge does not answer with its manifest")
    return RobotFacts(percepts, declared)


def _of_the_file(mission: Mission, robot: str) -> dict[str, Any] | None:
    """Return the percepts of the mission's manifest: a bridge may show its own only to operators at its board."""
    named = mission.robots[robot].manifest
    if not isinstance(named, str):
        return None
    try:
        manifest = load_manifest(named, mission.path.parent)
    except Findings:
        return None
    return {
        name: {
            "driver": manifest.driver_of(entry),
            "source": entry.source,
            "ttl": entry.ttl,
            "optional": entry.optional,
        }
        for name, entry in manifest.percepts.items()
    }


def show(diagnoses: Sequence[Diagnosis], *, as_json: bool) -> None:
    """Print the findings, and the number of errors and warnings."""
    errors = sum(one.level == "error" for one in diagnoses)
    warnings = sum(one.level == "warning" for one in diagnoses)
    if as_json:
        report = {
            "well": not errors,
            "errors": errors,
            "warnings": warnings,
            "findings": [asdict(one) for one in diagnoses],
        }
        print(json.dumps(report, indent=2))
        return
    terminal = sys.stdout.isatty()
    width = max((len(one.what) for one in diagnoses), default=0)
    columns = max(40, shutil.get_terminal_size().columns - width - 11) if terminal else sys.maxsize
    for one in diagnoses:
        level = f"{STYLES[one.level]}{one.level:7}\x1b[0m" if terminal else f"{one.level:7}"
        lines = [*wrap(printable(one.text), columns), *(wrap(f"do: {one.do}", columns) if one.do else [])]
        print(f"{level}  {one.what:{width}}  {lines[0]}")
        for line in lines[1:]:
            print(f"{'':7}  {'':{width}}  {line}")
    print(f"{count(errors, 'error')}, {count(warnings, 'warning')}")
