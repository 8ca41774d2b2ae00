"""`argosy mail`: print queued messages and dead letters of a fleet's mailboxes."""

from __future__ import annotations

import asyncio
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Iterable, Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from argosy.cli.errors import BadInput
from argosy.cli.operator_bus import Where, add_mission_argument, add_router_argument, on_the_bus
from commd.bus.bus import Bus
from commd.process.process import EXIT_DONE, EXIT_FAILED
from schemas.files.findings import Findings, did_you_mean
from schemas.humanize import columns, count, joined, json_lines, printable, shortened, size, span
from schemas.mission.model import Mission, load_mission
from schemas.wire import keys
from schemas.wire.records import DeadLetter, Mailboxes, Queue
from schemas.wire.term_text import write

ANSWER_TIMEOUT = 5.0
"""Wall seconds for a `commd` to answer."""
LONGEST = 60
"""Shown characters of a dead letter's content."""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy mail`."""
    add_mission_argument(parser, "mission file: fleet, boards and router")
    parser.add_argument("--board", metavar="NAME", help="only this board (default: all of the mission)")
    add_router_argument(parser, "the mission's")
    parser.add_argument("--file", type=Path, metavar="PATH", help="read a board's database file, without any daemon")
    parser.add_argument("--dead", action="store_true", help="also list dead letters, the newest last")
    parser.add_argument("--json", action="store_true", help="as JSON, with dead letters")
    parser.set_defaults(fleet=None)


def run(args: Namespace) -> int:
    """Print the mailboxes. Returns 1 if a board or an agentd did not answer.

    Raises Findings for an unreadable mission or file.
    """
    if args.file is not None:
        from commd.mail.inspection import mailboxes_of_file  # a query needs no SQLite

        return _show([mailboxes_of_file(args.file)], [], args, {})
    if args.mission is None:
        raise BadInput("argosy mail: expected a MISSION, or a board's database by --file")
    mission = load_mission(args.mission)
    wanted = mission.board_names
    if args.board is not None:
        if args.board not in wanted:
            hint = did_you_mean(args.board, wanted)
            raise Findings.about(mission.path, f"no board `{args.board}`{hint}")
        wanted = [args.board]

    async def ask(bus: Bus, where: Where) -> int:
        (found, why), (within, _), tokens = await asyncio.gather(
            _ask_all(bus, keys.mailboxes(where.fleet, "*")),
            _ask_all(bus, keys.neighbour_mail(where.fleet, "*")),
            bus.tokens(keys.alive(where.fleet, "*", "agentd", "*")),
        )
        silent = [f"{board}: {why.get(board, 'its commd does not answer')}" for board in wanted if board not in found]
        silent += [f"somebody answers: {error}" for name, error in why.items() if name not in mission.board_names]
        silent += _without_answer(mission, [board for board in wanted if board in found], within, tokens)
        within = {name: one for name, one in within.items() if one.board in wanted}
        return _show([found[board] for board in wanted if board in found], silent, args, within)

    return on_the_bus(args, ask)


def _without_answer(
    mission: Mission, boards: Iterable[str], within: Mapping[str, Mailboxes], tokens: Iterable[str]
) -> Iterator[str]:
    """Yield, for each board, the agents whose agentd has not answered: the mail between them is not known."""
    answered = {one.header.boot for one in within.values()}
    processes = [(parsed[1], parsed[3]) for parsed in map(keys.parse_alive, tokens) if parsed is not None]
    known = {agent for agent, boot in processes if boot in answered}
    present = {agent for agent, _ in processes}
    for board in boards:
        unknown = [agent for agent in mission.agents_on(board) if agent not in known]
        for why, agents in (
            ("does not answer", [agent for agent in unknown if agent in present]),
            ("is not running", [agent for agent in unknown if agent not in present]),
        ):
            if agents:
                yield f"{board}: the agentd of {joined(agents)} {why}: the mail between its agents is not shown"


async def _ask_all(bus: Bus, key: str) -> tuple[dict[str, Mailboxes], dict[str, str]]:
    """Return records and errors by the name in the key."""
    found: dict[str, Mailboxes] = {}
    errors = await bus.ask_all(key, Mailboxes, ANSWER_TIMEOUT, lambda key, mail: found.__setitem__(_name(key), mail))
    return found, {_name(key): error for key, error in errors.items()}


def _name(key: str) -> str:
    parsed = keys.parse(key)
    return parsed[1] if parsed is not None else ""


def _show(boxes: list[Mailboxes], silent: list[str], args: Namespace, within: Mapping[str, Mailboxes]) -> int:
    """Print what waits at boards, and `within` daemons of agents, by their names."""
    if args.json:
        agents = {name: msgspec.to_builtins(one) for name, one in within.items()}
        print(json_lines({"boards": [msgspec.to_builtins(one) for one in boxes], "agents": agents, "silent": silent}))
    else:
        for one in boxes:
            print("\n".join(board_lines(one, args.dead)))
            for name, its in within.items():
                if its.board == one.board and its.queues:
                    print("\n".join(agentd_lines(name, its)))
    for text in silent:
        print(printable(f"error: {text}"), file=sys.stderr)
    return EXIT_FAILED if silent else EXIT_DONE


def board_lines(boxes: Mailboxes, dead: bool) -> list[str]:
    """Return the lines about one board, with its dead letters if asked for."""
    waiting = sum(queue.messages for queue in boxes.queues)
    head = f"{boxes.board}: {count(waiting, 'message')} waiting, {count(boxes.dead_count, 'dead letter')}"
    where = f"{boxes.store}, synchronous {boxes.synchronous}" if boxes.synchronous else boxes.store
    lines = [f"{head}  ({where})" if where else head]
    lines += [f"  {line}" for line in columns([_row(queue) for queue in boxes.queues], right=(2, 3))]
    if dead:
        lines += [f"  {_dead(letter)}" for letter in boxes.dead]
        if missing := boxes.dead_count - len(boxes.dead):
            lines.insert(len(lines) - len(boxes.dead), f"  {count(missing, 'older dead letter')} not shown")
    return [printable(line) for line in lines]


def agentd_lines(name: str, boxes: Mailboxes) -> list[str]:
    """Return the lines about mail within the agentd whose first agent is `name`."""
    waiting = sum(queue.messages for queue in boxes.queues)
    rows = [
        (queue.box, f"{queue.sender} > {queue.receiver}", count(queue.messages, "message")) for queue in boxes.queues
    ]
    lines = [f"{boxes.board}: {count(waiting, 'message')} waiting within the agentd of {name}"]
    return [printable(line) for line in (*lines, *(f"  {line}" for line in columns(rows, right=(2,))))]


def _row(queue: Queue) -> tuple[str, str, str, str, str]:
    messages = f"{count(queue.messages, 'message')}, {size(queue.bytes)}"
    age = f"oldest {span(queue.oldest)}"
    return queue.box, f"{queue.sender} > {queue.receiver}", messages, age, printable(queue.state)


def _dead(letter: DeadLetter) -> str:
    message = letter.message
    at = datetime.fromtimestamp(letter.stamp / 1e9, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    content = write(message.content)
    what = f"{message.sender} > {message.receiver}  {message.performative} {shortened(content, LONGEST)}"
    return printable(f"dead  {at}  {what}: {letter.reason}")
