"""`argosy act`: command one action of an agent's robot and follow it to its end; the mission needs `inject: true`."""

from __future__ import annotations

import asyncio
import signal
from argparse import ArgumentParser, Namespace
from collections.abc import AsyncGenerator, Iterator
from contextlib import aclosing, contextmanager

from msgspec.structs import replace

from argosy.cli.arguments import duration, name
from argosy.cli.errors import BadInput, complain
from argosy.cli.fleet_bus import FleetBus
from argosy.cli.operator_bus import ANY, Unanswered, Where, add_fleet_arguments, on_the_bus, put_out, replies
from argosy.tools.record_text import read_action, status_text
from commd.bus.bus import Bus
from commd.bus.errors import BusClosed, BusError
from commd.process.process import EXIT_DONE, EXIT_FAILED, on_end_signals
from schemas.files.findings import did_you_mean
from schemas.humanize import printable
from schemas.liveness import ROUTER_GRACE
from schemas.manifest.loader import ActionDescription
from schemas.mission.model import Agent, Client
from schemas.wire import keys
from schemas.wire.records import Action, ActionStatus, Cancel, Perception
from schemas.wire.term_text import BadTerm, write
from schemas.wire.terms import Structure, Term

AT_MOST = 3600.0
"""Wall seconds of one query; after that it is repeated with the same id."""
CANCEL_PATIENCE = 5.0
"""Wall seconds for a bridge to confirm a cancelled action."""
RETRY = 0.2


class Lost(Exception):
    """The outcome of the action is unknown; the text says why."""


async def follow(bus: Bus, fleet: str, action: Action) -> AsyncGenerator[ActionStatus, None]:
    """Request an action and yield its statuses; the last one is final. Raises Lost."""
    loop, key = asyncio.get_running_loop(), keys.action(fleet, action.agent, action.name)
    heard, reason, taken = loop.time(), "no bridge answers for it: is it running?", False
    while True:
        try:
            async with aclosing(replies(bus, key, action, ActionStatus, AT_MOST)) as statuses:
                async for status in statuses:
                    if isinstance(status, str):
                        reason = status
                        continue
                    heard, taken, reason = loop.time(), True, "its answers ended without an outcome"
                    yield status
                    if status.final:
                        return
        except TimeoutError as silent:
            raise Lost(str(silent)) from None
        except BusClosed as closed:
            reason = str(closed)
        if loop.time() - heard > (ROUTER_GRACE if taken else 0):
            raise Lost(reason)
        if taken:  # the same id joins the running action, it never starts it again
            action = replace(action, attempt=action.attempt + 1)
        await asyncio.sleep(RETRY)


async def cancel(bus: Bus, fleet: str, agent: str, identity: str) -> ActionStatus | str:
    """Cancel an action. Returns its final status, or why that is unknown."""
    try:
        return await bus.ask_one(keys.cancel(fleet, agent), Cancel(id=identity), ActionStatus, CANCEL_PATIENCE)
    except BusError as error:
        return str(error)


LOOK = 3.0
"""Wall seconds for a bridge to list its actions."""
OVERTAKEN = 1.0
"""Wall seconds before an unknown action is cancelled once more: the cancellation may have overtaken the request."""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy act`."""
    parser.add_argument("agent", type=name, metavar="AGENT", help="agent on whose behalf its robot acts")
    what = "such as takeoff, or 'takeoff(5)' (default: list the actions)"
    parser.add_argument("action", nargs="?", metavar="ACTION", help=what)
    how = "values as in a program: 5, true, guided, '\"a text\"', '[1, 2]'"
    parser.add_argument("arguments", nargs="*", default=[], metavar="ARGUMENT", help=how)
    help_ = "time limit in mission time (default and maximum: the manifest's)"
    deadline = duration(lambda seconds: seconds > 0, "more than 0 s")
    parser.add_argument("--deadline", type=deadline, metavar="DURATION", help=help_)
    add_fleet_arguments(parser, "only this fleet (default: every fleet on the router)")


def run(args: Namespace) -> int:
    """Command an action and print its statuses. Returns 0 only if it has succeeded."""
    try:
        wanted, parameters = read_action(args.action, args.arguments) if args.action else ("", ())
    except BadTerm as bad:
        raise BadInput(str(bad)) from None

    async def act(bus: Bus, where: Where) -> int:
        session = await _session(bus, where, args.agent)
        fleet, there = await actions(session, where, args.agent)
        if not wanted:
            put_out("\n".join(printable(one.signature) for one in there))
            return EXIT_DONE
        if wanted not in {one.name for one in there}:
            known = did_you_mean(wanted, [one.name for one in there])
            raise BadInput(f"{args.agent}: there is no action `{wanted}`{known}")
        return await _perform(session, fleet, args.agent, wanted, parameters, args.deadline and float(args.deadline))

    return on_the_bus(args, act)


async def _session(bus: Bus, where: Where, agent: str) -> Bus:
    """Return the session with the board of the agent's robot: routers do not forward requests of operators."""
    mission = where.boards
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
    """Return the fleet of an agent, and its robot's actions. Raises Unanswered."""
    found: dict[str, list[ActionDescription]] = {}
    key = keys.action(where.fleet, agent, "*")
    async with aclosing(Bus.query(bus, key, None, ActionDescription, LOOK)) as replies:
        async for reply in replies:
            if reply.record is not None and (parsed := keys.parse(reply.key)) is not None:
                found.setdefault(parsed[0], []).append(reply.record)
    if len(found) > 1:
        raise Unanswered(f"fleets {' and '.join(sorted(found))} each have an agent `{agent}`: choose one by --fleet")
    if not found:
        raise Unanswered(await _nobody(bus, where, agent))
    return next(iter(found.items()))


async def _nobody(bus: Bus, where: Where, agent: str) -> str:
    """Return why no bridge answers for an agent's robot, by the tokens on the bus."""
    tokens = map(keys.parse_alive, await Bus.tokens(bus, keys.alive(where.fleet, "*", "*", "*")))
    there = {parsed[1] for parsed in tokens if parsed is not None and parsed[2] in ("agentd", "client")}
    rules = "; where access is controlled, only operators may ask, and only if the mission says `inject: true`"
    guarded = rules if bus.guarded else ""
    if agent in there:
        return f"agent `{agent}` is running, but no bridge answers for its robot{guarded}"
    of = f" of {where.whose}" if where.fleet != ANY else ""
    its = where.boards is None or agent not in where.boards.mailboxes
    why = f": there is no agent `{agent}`{did_you_mean(agent, there)}" if its else ""
    return f"no bridge{of} at {where.router} answers for `{agent}`{why}{guarded}"


async def _perform(
    bus: Bus, fleet: str, agent: str, name: str, parameters: tuple[Term, ...], deadline: float | None
) -> int:
    """Request the action and print each status. Ctrl-C, SIGTERM and SIGHUP cancel it and print the outcome."""
    identity, head = f"{bus.name}:{bus.boot}:1", f"{agent}: {write(Structure(name, parameters))}"
    known_as = f"; its id is {identity}"
    action = Action(
        header=bus.header("action"), id=identity, agent=agent, name=name, parameters=parameters, deadline=deadline
    )
    status: ActionStatus | None = None
    with _ending_as_ctrl_c_does() as signals:
        try:
            async with aclosing(follow(bus, fleet, action)) as statuses:
                async for status in statuses:
                    first = f", id {identity}" if status.state == "accepted" else ""
                    print_line(f"{head} {status_text(status)}{first}")
        except Lost as lost:
            begun = "how it ended is not known" if status is not None else "it is not known whether it began"
            complain(f"{head} NOT confirmed, {begun}: {lost}{known_as}")
            return EXIT_FAILED
        except asyncio.CancelledError:
            number = signals[0] if signals else signal.SIGINT
            print_line(f"{head}: {'ctrl-C' if number == signal.SIGINT else number.name}, cancelling it")
            ended = await cancel(bus, fleet, agent, identity)
            if status is None and not isinstance(ended, str) and ended.state == "refused":
                await asyncio.sleep(OVERTAKEN)
                ended = await cancel(bus, fleet, agent, identity)
            if isinstance(ended, str):
                complain(f"{head} NOT cancelled, it may go on: {ended}{known_as}")
            else:
                print_line(f"{head} {status_text(ended)}")
            return 128 + number
    if status is None or status.state != "succeeded":
        return EXIT_FAILED
    for percept in await _asked_for(bus, fleet, agent, parameters):
        print_line(f"{agent}: {percept}")
    return EXIT_DONE


async def _asked_for(bus: Bus, fleet: str, agent: str, parameters: tuple[Term, ...]) -> list[str]:
    """Return the percepts that an action by name leads to, such as `parameter("RTL_ALT", 1500)` of `get_param`.

    They begin with the arguments of the action, the first of which is a text.
    """
    found: list[str] = []
    if not (parameters and isinstance(parameters[0], str)):
        return found
    try:
        key, size = keys.percept(fleet, agent, "**"), len(parameters)
        async with aclosing(Bus.query(bus, key, None, Perception, LOOK)) as answers:
            async for answer in answers:
                if (percept := answer.record) is not None and percept.parameters[:size] == parameters:
                    found.append(write(Structure(percept.name, percept.parameters)))
    except BusClosed as closed:
        complain(f"note: its result is not known: {closed}")
    return found


@contextmanager
def _ending_as_ctrl_c_does() -> Iterator[list[signal.Signals]]:
    """Let SIGTERM and SIGHUP cancel this task once, like ctrl-C; the list then holds the signal."""
    loop, task, got = asyncio.get_running_loop(), asyncio.current_task(), list[signal.Signals]()

    def end(number: signal.Signals) -> None:
        if task is not None and not got:
            got.append(number)
            task.cancel()

    taken = on_end_signals(end, signal.SIGTERM, signal.SIGHUP)
    try:
        yield got
    finally:
        for number in taken:
            loop.remove_signal_handler(number)


def print_line(line: str) -> None:
    """Print a line; without a reader the action continues all the same."""
    try:
        put_out(printable(line))
    except Unanswered as lost:
        complain(f"note: {lost}")
