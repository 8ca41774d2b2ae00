"""The agent daemon: one or several agents of a mission, each a mind of its own, in one process on the bus."""

from __future__ import annotations

import asyncio
import logging
from argparse import ArgumentParser, Namespace
from pathlib import Path

from agentd.extensions.file_access import state_folder
from agentd.persistence.checkpoint import CheckpointError
from agentd.process import allow_deep_calls
from agentd.runtime.agent_group import AgentGroup
from agentd.runtime.program_loader import DECISIONS, prepare
from commd.bus.bus import open_bus
from commd.common.clock import Clock
from commd.common.tasks import wait_at_most
from commd.process.command_line import mission_speed
from commd.process.garbage import look_seldom
from commd.process.output import ERROR, stderr
from commd.process.process import EXIT_DONE, EXIT_FAILED, add_router_argument, greet, run_daemon, tls_of
from commd.process.restart_counter import note_start
from commd.process.state_dir import probe
from commd.process.systemd import Member, Unit
from schemas.files.findings import Finding, Findings
from schemas.files.text_files import DISK_FAILS
from schemas.mission.model import Mission, load_mission

SPACE = 256 * 1024
"""Bytes that a new checkpoint needs with its log."""
PATIENCE = 20.0
"""Wall seconds to wait for space; then the daemon ends, and is started again, before it counts as hung."""
LOOK = 1.0
"""Wall seconds between two attempts to write to a full disk."""
log = logging.getLogger("agentd")


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `agentd serve`."""
    parser.add_argument("mission", help="mission file")
    parser.add_argument("agents", nargs="*", metavar="AGENT", help="agents to run (default: all of the board)")
    parser.add_argument("--board", help="board whose agents to run (default: all boards of the mission)")
    add_router_argument(parser)
    parser.add_argument(
        "--speed",
        type=mission_speed,
        help="mission seconds per wall second, in simulation only (default: that of the mission)",
    )
    parser.add_argument(
        "--state",
        metavar="DIR",
        help="folder whose FLEET has the checkpoint and the files of .save_agent (default: the user's state folder)",
    )
    parser.add_argument(
        "--fresh",
        action="store_true",
        help="delete the state of these agents, so that they start with their initial goals",
    )
    parser.add_argument("--seed", type=int, default=0, help="integer that random numbers start from (default 0)")
    parser.add_argument(
        "--decisions",
        type=int,
        default=DECISIONS,
        metavar="N",
        help=f"number of last decisions that each agent keeps for observers (default {DECISIONS}; 0: none)",
    )


def run(args: Namespace) -> int:
    """Run the daemon until a signal or a program stops it. Returns the exit code."""
    allow_deep_calls()

    async def main(stop: asyncio.Event) -> int:
        mission = load_mission(args.mission)
        look_seldom(len(chosen(mission, args)))
        return await serve(mission, args, stop)

    return run_daemon("agentd", main)


async def serve(mission: Mission, args: Namespace, stop: asyncio.Event, unit: Member | None = None) -> int:
    """Compile the agents' programs, join the bus under each agent's name, and reason."""
    clock = Clock(args.speed or mission.speed)
    unit = unit or Unit().member("agentd")
    parts = [prepare(mission, name, args.seed, args.decisions) for name in chosen(mission, args)]
    name = parts[0].name
    endpoint = args.router or mission.router.endpoint
    unit.status(f"waiting for the router at {endpoint}")
    async with open_bus(
        endpoint,
        fleet=mission.fleet,
        name=name,
        daemon="agentd",
        wire=mission.wire,
        stop=stop,
        tls=tls_of(args),
    ) as bus:
        await greet(bus, (mission.agents[part.name].board for part in parts))
        folder = state_folder(args.state, mission.fleet)
        if any(mission.agents[part.name].on_restart != "fresh" for part in parts):
            await wait_for_disk(folder, unit, stop)
        if stop.is_set():
            return EXIT_DONE
        agent_group = AgentGroup(bus, clock, mission, folder, args.seed, fresh=args.fresh, unit=unit)
        try:
            await agent_group.add(*parts)
        except CheckpointError as error:
            stderr().write(f"error: agentd: {error}", ERROR)
            return EXIT_FAILED
        bus.restarts, bus.former_failure = note_start(folder, "agentd", name)
        log.info("agents=%s", ",".join(agent_group.hosts))
        await agent_group.run(stop)
    return EXIT_DONE if agent_group.stopped is None else agent_group.stopped.exit_code


async def wait_for_disk(folder: Path, unit: Member, stop: asyncio.Event) -> None:
    """Wait until the disk of a folder has space, or `stop` is set. Raises OSError if it has none for `PATIENCE`.

    An agent that began without its state would forget what it did; until it joins, it counts as lost, and its robot is
    brought to safety. Other errors than of a full or broken disk are left to what opens the checkpoint.
    """
    loop, reported = asyncio.get_running_loop(), False
    until = loop.time() + PATIENCE
    while not stop.is_set():
        try:
            await asyncio.to_thread(probe, folder, SPACE)
        except OSError as error:
            if error.errno not in DISK_FAILS:
                return
            if loop.time() > until:
                raise
            if not reported:
                log.error("no agent begins before its state can be kept: %s: %s", folder, error.strerror)
                unit.status(f"waiting for the disk of {folder}: {error.strerror}")
            reported = True
            await wait_at_most(stop, LOOK)
        else:
            return


def chosen(mission: Mission, args: Namespace) -> list[str]:
    """Return the agents that this daemon runs. Raises Findings if there are none, or one is not in the mission."""
    agents = args.agents or [name for name, agent in mission.agents.items() if args.board in (None, agent.board)]
    unknown = [name for name in agents if name not in mission.agents]
    if unknown or not agents:
        what = f"there is no agent `{unknown[0]}`" if unknown else f"board `{args.board}` has no agents"
        known = f"; the agents are {', '.join(mission.agents)}"
        raise Findings([Finding(str(mission.path), 0, 0, what + known)])
    return list(dict.fromkeys(agents))
