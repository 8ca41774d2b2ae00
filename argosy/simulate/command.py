"""`argosy simulate`: the simulated robots of a mission that belong to one machine, in the foreground until ctrl-C.

For a computer that only simulates: the daemons of the mission run on their boards, and know of nothing. `argosy run`
starts its simulators itself.
"""

from __future__ import annotations

import asyncio
import signal
import sys
from argparse import ArgumentParser, Namespace
from contextlib import suppress
from pathlib import Path

from argosy.check.command import at_start, check_mission
from argosy.cli.port_check import endpoint, link_in_use
from argosy.processes.mavlink_links import MEETING, address_of, peer_of
from argosy.processes.process_table import Kind, Process, python_command, real_robots
from argosy.processes.simulators import command, machine_of, only_real, require_links, vehicle_of
from argosy.processes.supervisor import Child, Supervisor
from bridged.drivers.mavlink.transport.address import LinkAddressError
from commd.process.command_line import mission_speed
from commd.process.process import EXIT_DONE, EXIT_FAILED, on_end_signals
from schemas.files.findings import Finding, Findings, did_you_mean
from schemas.files.units import host_and_port
from schemas.mission.model import DEFAULT_PORT, Mission
from schemas.wire.log_lines import LogLine

LEAVE = 1.0
"""Wall seconds that a simulator has to leave."""
_KIND = Kind("simulator", lambda setup: [], lambda setup, subject: [], daemon=False)


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy simulate`."""
    parser.add_argument("mission", help="mission file")
    parser.add_argument(
        "--board",
        metavar="MACHINE",
        help="simulate the robots of this machine, by `simulate.board` or `board` (default: the only one)",
    )
    parser.add_argument(
        "--speed", type=mission_speed, metavar="X", help="mission seconds per wall second (default: the mission's)"
    )
    parser.add_argument(
        "--real", action="append", default=[], metavar="ROBOT", help="do not simulate ROBOT (or `all`): it is real"
    )
    parser.add_argument(
        "--router",
        type=endpoint,
        metavar="ENDPOINT",
        help="router for simulated robots on Zenoh (default: the board's address)",
    )
    parser.add_argument(
        "--report",
        type=Path,
        metavar="DIR",
        help="write servo logs of simulated copters to this folder, for `argosy referee`",
    )


def run(args: Namespace) -> int:
    """Simulate until ctrl-C. Returns the exit code: 1 if a simulator ended by itself. Raises Findings."""
    mission, findings = check_mission(args.mission)
    errors = [finding for finding in at_start(findings) if finding.severity == "error"]
    if mission is None or errors:
        raise Findings(errors)
    require_links(mission)
    return asyncio.run(_watch(_processes(mission, args)))


def _processes(mission: Mission, args: Namespace) -> list[Process]:
    """Return what is to be started on this machine. Raises Findings with everything that keeps it from starting."""
    real, unknown = real_robots(mission, [name for names in args.real for name in names.split(",")])
    findings = [_finding(mission, f"--real {name}: there is no such robot") for name in unknown]
    findings += [
        mission.positions.finding(("robots", name, "link"), f"{name}: {why}; it is flown with --real {name}")
        for name, why in only_real(mission).items()
        if name not in real
    ]
    simulated = {name: robot for name, robot in mission.robots.items() if vehicle_of(robot) and name not in real}
    machine = _machine(mission, args.board, sorted({machine_of(robot) for robot in simulated.values()}))
    speed = ["--speed", f"{mission.speed if args.speed is None else args.speed:g}"]
    processes: list[Process] = []
    for name, robot in simulated.items():
        if machine_of(robot) != machine:
            continue
        try:
            apart = mission.host_of(robot.board) if machine != robot.board else None
            if (link := address_of(robot)) is not None:
                end = peer_of(link, apart)
                if end.kind in MEETING and end.port and (why := link_in_use(end)):
                    raise ValueError(f"{end} {why}")
            argv = command(mission, name, args.router or _router(mission, robot.board, apart), apart, args.report)
        except (LinkAddressError, ValueError) as error:
            findings.append(mission.positions.finding(("robots", name, "link"), f"{name}: {error}"))
            continue
        processes.append(Process(_KIND, name, (*python_command(), *argv, *speed), signal.SIGKILL, name, machine))
    if findings:
        raise Findings(findings)
    return processes


def _machine(mission: Mission, asked: str | None, known: list[str]) -> str:
    """Return the machine whose robots are to be simulated. Raises Findings."""
    there = f"there is {', '.join(known)}" if known else "the mission has no simulated robot"
    if asked is None:
        if len(known) != 1:
            raise Findings([_finding(mission, f"name this machine by --board: {there}")])
        return known[0]
    if asked not in known:
        raise Findings(
            [_finding(mission, f"nothing is simulated on `{asked}`{did_you_mean(asked, known) or f': {there}'}")]
        )
    return asked


def _finding(mission: Mission, text: str) -> Finding:
    return Finding(str(mission.path), 0, 0, text)


def _router(mission: Mission, board: str, apart: str | None) -> str:
    """Return the router of a robot's board as this machine reaches it."""
    if not apart:
        return mission.router.endpoint
    host, port = host_and_port(mission.boards[board].address, DEFAULT_PORT)
    return f"tcp/{host}:{port}"


async def _watch(processes: list[Process]) -> int:
    """Start the simulators and print their output, until a signal or the end of one of them."""
    stop, hurry = asyncio.Event(), asyncio.Event()
    on_end_signals(lambda _: (hurry if stop.is_set() else stop).set())
    supervisor = Supervisor(_print_line, lambda child: stop.set())
    try:
        for process in processes:
            await supervisor.start(process)
        await stop.wait()
        dead = supervisor.dead()
        for child in dead:
            print(f"error: {child.name} {child.how_it_ended()}", file=sys.stderr)
        await supervisor.leave(supervisor.children, LEAVE, hurry)
    finally:
        await supervisor.close()
    return EXIT_FAILED if dead else EXIT_DONE


def _print_line(child: Child, line: LogLine) -> None:
    with suppress(OSError):
        print(f"{child.name}: {line.text}", flush=True)
