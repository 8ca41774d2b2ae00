"""Access rights by the mission and the table of channels: what routers enforce on each link, and which mail an agent
accepts (docs/guides/security.md).

A name belongs to one board: only that board publishes, serves and queries under it. Everybody in the fleet may see
telemetry; minds and mail are for operators, and for observers that the mission names. `commd.router.config` writes the
rules for Zenoh.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, fields
from itertools import islice

from msgspec.structs import replace

from schemas.files.findings import Finding, Findings
from schemas.manifest.loader import Manifest, load_manifest
from schemas.mission.model import ALL, ANYBODY, RESERVED, Accepted, Mission
from schemas.wire import keys
from schemas.wire.keys import ROOT, SIGHTS, Channel, Sight, is_name
from schemas.wire.records import BoardServices, Message
from schemas.wire.terms import Structure

UNDELIVERED = "mail"
"""The sender of notices about undelivered mail, which go to senders on other boards too."""
BOARD_SEES: Sight = "telemetry"
"""Rights of a board to records of the agents of other boards."""
ZENOH = "zenoh"
"""The driver whose robots use keys of their own."""


@dataclass(frozen=True)
class Rights:
    """Rights at a router, as key expressions. Everything else is denied."""

    puts: tuple[str, ...] = ()
    """Publish."""
    deletes: tuple[str, ...] = ()
    """Publish deletions: no daemon of Argosy does, a robot may."""
    serves: tuple[str, ...] = ()
    """Answer queries."""
    asks: tuple[str, ...] = ()
    """Query."""
    hears: tuple[str, ...] = ()
    """Subscribe."""
    holds: tuple[str, ...] = ()
    """Have liveliness tokens."""
    watches: tuple[str, ...] = ()
    """Follow or list liveliness tokens."""

    def __add__(self, other: Rights) -> Rights:
        return Rights(
            **{each.name: _once(getattr(self, each.name) + getattr(other, each.name)) for each in fields(self)}
        )


def of_observer(sight: Sight) -> Rights:
    """Return the rights of an observer: queries that change nothing, and all publications except `hidden` ones."""
    everything = (f"{ROOT}/**",)
    seen = SIGHTS[: SIGHTS.index(sight) + 1]
    reads = (
        f"{ROOT}/*/{_any(channel.key)}" for channel in keys.CHANNELS if _is_read(channel) and channel.sight in seen
    )
    return Rights(asks=tuple(reads), hears=everything, watches=everything)


def hidden(sight: Sight) -> tuple[str, ...]:
    """Return the keys whose publications are withheld from an observer with this sight."""
    beyond = SIGHTS[SIGHTS.index(sight) + 1 :]
    return _once([f"{ROOT}/*/{_any(channel.key)}" for channel in keys.CHANNELS if channel.sight in beyond])


def of_operator(inject: bool = False) -> Rights:
    """Return the rights of an operator: see everything, stop robots, change manifests, list mail, publish a run's
    state.

    `inject`: as the mission says; then also act in the name of any agent, and give it percepts.
    """
    orders = (f"{ROOT}/*/{_any(channel.key)}" for channel in keys.CHANNELS if _is_order(channel))
    by_hand = keys.percept_by_hand("*", "*", "*")
    puts = (f"{ROOT}/*/{_any(channel.key)}" for channel in keys.CHANNELS if channel.source == "operator")
    rights = of_observer("mail") + Rights(puts=tuple(key for key in puts if key != by_hand), asks=tuple(orders))
    if not inject:
        return rights
    return rights + Rights(puts=(by_hand,), asks=(keys.action("*", "*", "**"), keys.cancel("*", "*")))


def of_board(mission: Mission, board: str) -> Rights:
    """Return the rights of a board at all routers: speak and act for the names that live on it.

    Of agents of other boards it sees `BOARD_SEES`: their minds contain what others have sent them.
    """
    puts, serves, asks, holds = list[str](), list[str](), list[str](), list[str]()
    for channel in keys.CHANNELS:
        published = list(_keys_of(mission, board, channel))
        match channel.kind:
            case "put":
                puts += published
            case "token":
                holds += published
            case "query":
                serves += published
                asks += _asked_by(mission, board, channel)
    own = Rights(puts=_once(puts), serves=_once(serves), asks=_once(asks), holds=_once(holds))
    return of_observer(BOARD_SEES) + own


def of_member(mission: Mission, board: str) -> Rights:
    """Return the rights of a daemon at its board's router: those of the board and an operator, and the robots' own
    keys.

    Of the router's admin space it may query the router's own entry only: a router that lists declarations may hang.
    Raises Findings for a manifest that cannot be read.
    """
    robots = robot_keys(mission, board)
    on_robots = Rights(puts=robots, deletes=robots, serves=robots, asks=(*robots, "@/*/router"), hears=robots)
    return of_board(mission, board) + of_operator(mission.inject) + on_robots


def robot_keys(mission: Mission, board: str, other: str | None = None) -> tuple[str, ...]:
    """Return the keys, besides Argosy's, of robots that belong to a board or are simulated there.

    With an `other` board, only of robots that belong to one of the two and are simulated on the other. Raises Findings
    for a manifest that cannot be read.
    """
    found: list[str] = []
    for robot in mission.robots.values():
        places = {robot.board, (robot.simulate.board if robot.simulate is not None else None) or robot.board}
        if board not in places or (other is not None and places != {board, other}):
            continue
        if robot.prefix:
            found.append(f"{robot.prefix}/**")
        elif isinstance(robot.manifest, str):
            found += _spoken(load_manifest(robot.manifest, mission.path.parent))
    return _once(found)


def made_on(board: str) -> str:
    """Return the prefix of all names made at run time on a board, where access is controlled."""
    return f"{board}_"


MOST_JOINED = 10_000
"""Agents that may join one board at run time."""
MOST_NAMES = 2 * MOST_JOINED
"""Agents of another board: those that joined it, and the mission's."""
MOST_SERVICES = 1_000
"""Services of one agent."""
LONGEST_SERVICE = 1_000
"""Characters of the name of a service."""


def checked(record: BoardServices, mission: Collection[str], secured: bool) -> BoardServices:
    """Return a record of another board without invalid names and excess entries.

    `secured`: also without names that it may not speak for. Those of the `mission` have the board that it says.
    """

    def may_name(name: str) -> bool:
        return is_name(name) and (not secured or name in mission or name.startswith(made_on(record.board)))

    agents = {
        name: tuple(one for one in record.agents[name][:MOST_SERVICES] if 0 < len(one) <= LONGEST_SERVICE)
        for name in islice(filter(may_name, record.agents), MOST_NAMES)
    }
    return record if agents == record.agents else replace(record, agents=agents)


def check(mission: Mission) -> None:
    """Raise Findings for a mission whose boards these rules cannot distinguish, or which cannot reach each other."""
    findings = []
    homes = dict(mission.mailboxes) | {name: robot.board for name, robot in mission.robots.items()}
    homes |= dict.fromkeys((*mission.security.operators, *mission.security.observers), "")
    homes |= {board: board for board in mission.board_names}
    for board in mission.board_names:
        for name, home in homes.items():
            if name.startswith(made_on(board)) and home != board:
                where = f"belongs to {home}" if home else "is no agent"
                text = (
                    f"`{name}` {where}, but names that begin with `{made_on(board)}` are for agents that {board} makes"
                )
                findings.append(Finding(str(mission.path), 0, 0, f"{text} at run time: rename it"))
    if len(silent := [name for name in mission.boards if not mission.boards[name].address]) > 1:
        text = (
            f"boards {' and '.join(silent)} have no address: neither can dial the other, and no third board may relay"
        )
        findings.append(Finding(str(mission.path), 0, 0, f"{text}: give all boards but one an address"))
    if findings:
        raise Findings(findings)


def _is_read(channel: Channel) -> bool:
    """Whether a query changes nothing and is not for operators only."""
    return channel.kind == "query" and channel.carries is None and not _is_order(channel)


def _is_order(channel: Channel) -> bool:
    """Whether it is an operator's query."""
    return channel.kind == "query" and "operator" in channel.sink.split(", ")


def _any(key: str) -> str:
    """Return the key expression of a row for all names."""
    return "/".join("*" if chunk.startswith("{") else chunk for chunk in key.split("/"))


def _keys_of(mission: Mission, board: str, channel: Channel) -> Iterator[str]:
    """Yield the keys of a row on which a board's daemons put, serve or hold tokens."""
    first, *rest = channel.key.split("/")
    fixed = "".join(f"{chunk}/" for chunk in rest if not chunk.startswith(("{", "*")))
    for name in _names(mission, board, channel.source, first):
        yield f"{ROOT}/{mission.fleet}/{name}/{fixed}**"


def _names(mission: Mission, board: str, source: str, named: str) -> Collection[str]:
    """Return the names that a board's daemons may use in the first chunk of a row with this source."""
    robots = mission.robots_on(board)
    match source, named:
        case "operator", _:
            return []
        case _, "{board}":
            return [board]
        case _, "{robot}":
            return robots
        case "bridged", _:
            return list(dict.fromkeys(agent for robot in robots for agent in mission.agents_of(robot)))
        case "every daemon", _:
            return [board, *robots, *_senders(mission, board)]
        case _:
            return _senders(mission, board)


def _senders(mission: Mission, board: str) -> list[str]:
    """Return the names with a mailbox on a board, and a pattern of those that will be made there."""
    named = [name for name, home in mission.mailboxes.items() if home == board]
    return [*named, f"{made_on(board)}$*"]


def _asked_by(mission: Mission, board: str, channel: Channel) -> Iterator[str]:
    """Yield the keys of a row that a board's daemons query with an effect: those with one of its agents as agent or
    sender, and those of the board itself, which sees whom a request is for."""
    chunks = channel.key.split("/")
    place = next((i for i, chunk in enumerate(chunks) if chunk in ("{agent}", "{sender}")), None)
    # Boards query each other in their own names, not in that of an agent.
    among_boards = channel.kind == "query" and "commd" in channel.sink.split(", ") and chunks[0] == "{board}"
    if among_boards and not _is_read(channel):
        yield f"{ROOT}/{mission.fleet}/{_any(channel.key)}"
    elif channel.carries is None or _is_order(channel) or place is None:
        return
    elif chunks[0] == "{board}":
        yield f"{ROOT}/{mission.fleet}/{board}/{'/'.join(chunks[1:place])}/**"
    else:
        for name in (*_senders(mission, board), *((UNDELIVERED,) if chunks[place] == "{sender}" else ())):
            named = [name if i == place else chunk for i, chunk in enumerate(chunks)]
            fixed = named[: place + 1] + [chunk for chunk in named[place + 1 :] if not chunk.startswith("{")]
            yield f"{ROOT}/{mission.fleet}/{_any('/'.join(fixed))}/**"


def _spoken(manifest: Manifest) -> Iterator[str]:
    """Yield the keys that a manifest has for robots on Zenoh."""
    for percept in manifest.percepts.values():
        if manifest.driver_of(percept) == ZENOH:
            yield percept.source
    for action in manifest.actions.values():
        if manifest.driver_of(action) == ZENOH:
            yield from filter(None, (action.topic, action.service))


def _once(names: Collection[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(names))


NOT_ACCEPTED = "not_accepted"
"""Code of the refusal that the sender gets."""
NOTICES = {"mail": ("signal", "undelivered"), "df": ("tell", "provider")}
"""Performative and functor of the notices of each reserved sender."""
PLAN_MAIL = frozenset(("tellHow", "untellHow", "askHow"))
"""Performatives that change or read a program: refused from other boards of a secured fleet."""
FROM_GATEWAY = frozenset(("tell",))
"""Performatives that a node behind the gateway may send: UDP is not authenticated."""


@dataclass(frozen=True)
class MailRights:
    """Which mail one agent accepts."""

    mission: Mission
    agent: str
    board: str
    """Where the agent runs."""

    def accept(self, message: Message) -> bool:
        """Whether the agent accepts a message, by its sender and performative."""
        sender, performative = message.sender, message.performative
        if sender in RESERVED:
            content = message.content
            return isinstance(content, Structure) and NOTICES.get(sender) == (performative, content.functor)
        return self.accepts(sender, performative)

    def accepts(self, sender: str, performative: str) -> bool:
        """Whether the agent accepts messages of this performative from another agent or program, or from itself."""
        if sender == self.agent:
            return True
        agent = self.mission.agents.get(self.agent)
        named = {} if agent is None else agent.accepts
        if sender in named:
            return _holds(named[sender], performative)
        if ANYBODY in named and not _holds(named[ANYBODY], performative):
            return False
        gateway = self.mission.gateway
        if gateway is not None and sender in gateway.nodes:
            return performative in FROM_GATEWAY
        if ANYBODY in named or not self.mission.secured or performative not in PLAN_MAIL:
            return True
        home = self.mission.mailboxes.get(sender)
        return sender.startswith(made_on(self.board)) if home is None else home == self.board


def _holds(accepted: Accepted, performative: str) -> bool:
    return accepted == ALL or performative in accepted
