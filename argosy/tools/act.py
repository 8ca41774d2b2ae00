"""`argosy act`: one action of an agent's robot by hand, followed to its end, where the mission says `inject: true`."""

from __future__ import annotations

import asyncio
import sys
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from contextlib import aclosing, suppress

from argosy.fleet_bus import FleetBus
from argosy.operator_bus import ANY, Unanswered, Where, add_fleet_arguments, on_the_bus
from argosy.tools.calls import called, read_action, unknown
from argosy.tools.following import Lost, cancel, follow
from commd.bus import Bus
from commd.process import EXIT_BAD_INPUT, EXIT_DONE, EXIT_FAILED
from schemas import keys
from schemas.durations import Duration
from schemas.manifest import ActionDescription
from schemas.mission import Agent, Client
from schemas.positions import did_you_mean
from schemas.records import Action, ActionStatus
from schemas.terms import Term
from schemas.text import BadTerm

EXIT_INTERRUPTED = 130
LOOK = 3.0
"""Wall seconds that a bridge has to say which actions there are."""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy act`."""
    parser.add_argument("agent", metavar="AGENT", help="whose robot acts, in its name")
    what = "such as takeoff, or 'takeoff(5)'; none: which there are"
    parser.add_argument("action", nargs="?", metavar="ACTION", help=what)
    how = "as a program writes them: 5, true, guided, '\"a text\"', '[1, 2]'"
    parser.add_argument("arguments", nargs="*", default=[], metavar="ARGUMENT", help=how)
    help_ = "the time that it has, in mission seconds (default, and at most: the manifest's)"
    parser.add_argument("--deadline", type=_deadline, metavar="DURATION", help=help_)
    add_fleet_arguments(parser, "only this fleet (default: every fleet on the router)")


def _deadline(text: str) -> float:
    try:
        seconds = float(Duration.read(text))
    except ValueError as error:
        raise ArgumentTypeError(str(error)) from None
    if seconds <= 0:
        raise ArgumentTypeError(f"expected more than 0 s, got {text}")
    return seconds


def run(args: Namespace) -> int:
    """Let a robot act, and print what becomes of it. Returns 0 only if it has succeeded."""
    try:
        name, parameters = read_action(args.action, args.arguments) if args.action else ("", ())
    except BadTerm as bad:
        print(f"error: {bad}", file=sys.stderr)
        return EXIT_BAD_INPUT

    async def act(bus: Bus, where: Where) -> int:
        try:
            session = await _session(bus, where, args.agent)
            fleet, there = await actions(session, where, args.agent)
        except Unanswered as unanswered:
            print(f"error: {unanswered}", file=sys.stderr)
            return EXIT_FAILED
        if not name:
            for one in there:
                say(f"{one.signature}")
            return EXIT_DONE
        if name not in {one.name for one in there}:
            print(f"error: {args.agent}: {unknown('action', name, [one.name for one in there])}", file=sys.stderr)
            return EXIT_BAD_INPUT
        return await _perform(session, fleet, args.agent, name, parameters, args.deadline)

    return on_the_bus(args, act)


async def _session(bus: Bus, where: Where, agent: str) -> Bus:
    """Return the session with the board whose bridge moves the agent's robot: a router passes on nobody's requests."""
    mission = where.mission
    if not isinstance(bus, FleetBus) or mission is None:
        return bus
    members: dict[str, Agent | Client] = {**mission.agents, **mission.clients}
    if agent not in members:
        raise Unanswered(f"{mission.path.name} has no agent `{agent}`{did_you_mean(agent, members)}")
    robot = members[agent].robot
    if robot is None:
        raise Unanswered(f"agent `{agent}` has no robot")
    board = mission.robots[robot].board
    session = await bus.boards.bus(board)
    if isinstance(session, str):
        raise Unanswered(f"board {board}, where {robot} is, is not reached: {session}")
    return session


async def actions(bus: Bus, where: Where, agent: str) -> tuple[str, list[ActionDescription]]:
    """Return the fleet of an agent, and what its robot can do. Raises Unanswered."""
    found: dict[str, list[ActionDescription]] = {}
    key = keys.action(where.fleet, agent, "*")
    async with aclosing(Bus.query(bus, key, None, ActionDescription, LOOK)) as replies:
        async for reply in replies:
            if reply.record is not None and (parsed := keys.parse(reply.key)) is not None:
                found.setdefault(parsed[0], []).append(reply.record)
    if len(found) > 1:
        raise Unanswered(f"fleets {' and '.join(sorted(found))} each have an agent `{agent}`: say which by --fleet")
    if not found:
        raise Unanswered(await _nobody(bus, where, agent))
    return next(iter(found.items()))


async def _nobody(bus: Bus, where: Where, agent: str) -> str:
    """Say why nobody answers for an agent's robot, as far as the tokens on the bus tell."""
    tokens = await Bus.tokens(bus, keys.alive(where.fleet, "*", "*", "*"))
    parsed = [found for token in tokens if (found := keys.parse(token)) is not None]
    there = {name for _, name, rest in parsed if rest[1] in ("agentd", "client")}
    rules = "; where access is controlled, only operators may ask, and only if the mission says `inject: true`"
    guarded = rules if bus.guarded else ""
    if agent in there:
        return f"agent `{agent}` is there, and no bridge answers for a robot of it{guarded}"
    of = f" of fleet `{where.fleet}`" if where.fleet != ANY else ""
    its = where.mission is None or agent not in where.mission.mailboxes
    why = f": {unknown('agent', agent, sorted(there))}" if its else ""
    return f"no bridge{of} at {where.router} answers for `{agent}`{why}{guarded}"


async def _perform(
    bus: Bus, fleet: str, agent: str, name: str, parameters: tuple[Term, ...], deadline: float | None
) -> int:
    """Ask, and tell each status. Ctrl-C cancels the action, and says what became of it."""
    identity, head = f"{bus.name}:{bus.boot}:1", f"{agent}: {called(name, parameters)}"
    action = Action(
        header=bus.header("action"), id=identity, agent=agent, name=name, parameters=parameters, deadline=deadline
    )
    status: ActionStatus | None = None
    try:
        async with aclosing(follow(bus, fleet, action)) as statuses:
            async for status in statuses:
                say(f"{head} {in_words(status)}")
    except Lost as lost:
        begun = "how it ended is not known" if status is not None else "whether it was begun is not known"
        print(f"{head} NOT confirmed, {begun}: {lost}", file=sys.stderr)
        return EXIT_FAILED
    except asyncio.CancelledError:  # ctrl-C
        say(f"{head}: ctrl-C, cancelling it")
        ended = await cancel(bus, fleet, agent, identity)
        if isinstance(ended, str):
            print(f"{head} NOT cancelled, it may go on: {ended}", file=sys.stderr)
        else:
            say(f"{head} {in_words(ended)}")
        return EXIT_INTERRUPTED
    return EXIT_DONE if status is not None and status.state == "succeeded" else EXIT_FAILED


def in_words(status: ActionStatus) -> str:
    """Return what has become of an action: `running, altitude 3.2`, `refused: busy: goto is running`."""
    said = status.state.replace("_", " ")
    if status.state == "accepted" and status.deadline is not None:
        said += f", {status.deadline:g} s at most"
    if status.feedback and not status.final:
        said += "".join(f", {what} {value:.4g}" for what, value in status.feedback.items())
    if status.reason:
        said += f": {status.reason}" if status.final else f", waits for {status.reason}"
    return said


def say(line: str) -> None:
    """Print a line, if anybody still reads: the action goes on without readers."""
    with suppress(OSError):
        print(line, flush=True)
