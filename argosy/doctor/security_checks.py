"""Check access rules and certificates by trying them from this machine.

Compares what each router allows with the rights that the mission gives. The trials have no effect: puts and answers use
keys one level below those of daemons, queries carry no record, and tokens belong to no daemon or agent.
"""

from __future__ import annotations

import asyncio
import os
import socket
import ssl
import time
from collections.abc import AsyncIterator, Collection, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import zenoh

from argosy.cli.operator_bus import names_there
from argosy.doctor.findings import Diagnosis
from commd.bus.access_probe import router_name, which_are_answered, which_come_through
from commd.bus.bus import Bus, open_bus
from commd.bus.errors import BusClosed
from commd.bus.router_endpoints import endpoint_of
from commd.bus.tls import SOON, Identity, Tls, day, files_in, identity_of, out_of_date, shown_by
from schemas.files.findings import Findings
from schemas.files.units import host_and_port
from schemas.humanize import count
from schemas.mission import access_rules
from schemas.mission.access_rules import Rights
from schemas.mission.model import DEFAULT_PORT, Mission
from schemas.wire import keys

PATIENCE = 3.0
"""Wall seconds for an allowed message to arrive."""
WHAT = "access"
RIGHTS = {"puts": "put on", "serves": "serve", "asks": "ask", "holds": "hold the token"}


@dataclass(frozen=True)
class Trial:
    """One action that the mission allows or denies."""

    right: str
    """A field of `Rights`."""
    key: str
    allowed: bool
    """Whether the mission allows it."""

    def __str__(self) -> str:
        return f"{RIGHTS[self.right]} {self.key}"


async def findings(bus: Bus, mission: Mission) -> list[Diagnosis]:
    """Compare the rights of this machine with what each reachable router allows."""
    if bus.endpoint.startswith("tcp/"):
        text = "the router accepts plain TCP: everybody who can reach it has all rights"
        do = "for boards in the field: `argosy keys init`, `argosy units` (docs/guides/security.md)"
        return [Diagnosis("warning", WHAT, text, do)] if any(b.address for b in mission.boards.values()) else []
    try:
        name, rights, routers = await _who(bus, mission)
    except Findings as problems:
        return [
            Diagnosis("error", WHAT, str(problems), "give the names of the mission's boards, operators or observers")
        ]
    found = await asyncio.gather(*(_at(bus, mission, name, rights, *router) for router in routers.items()))
    return [one for several in found for one in several]


async def _who(bus: Bus, mission: Mission) -> tuple[str, Rights, dict[str, str]]:
    """Return who this machine is, its rights, and the routers to try. Raises Findings."""
    if bus.tls is None:
        board = (await router_name(bus)).strip("`").rpartition("/")[2]
        known = board in mission.board_names
        return (
            f"a daemon of {board}",
            access_rules.of_member(mission, board) if known else Rights(),
            {board: bus.endpoint},
        )
    name = identity_of(bus.tls, time.time()).name
    routers = {board: endpoint_of(mission, board, "tls") for board in mission.boards if board != name}
    if bus.endpoint not in routers.values():
        routers = {bus.endpoint: bus.endpoint}
    routers = {board: endpoint for board, endpoint in routers.items() if endpoint}
    if name in mission.boards:
        return name, access_rules.of_board(mission, name), routers
    if name in mission.security.operators:
        return f"operator {name}", access_rules.of_operator(mission.inject), routers
    if sight := mission.security.sights.get(name):
        return f"observer {name}", access_rules.of_observer(sight), routers
    return f"`{name}` (not in the mission)", Rights(), routers


async def _at(bus: Bus, mission: Mission, name: str, rights: Rights, board: str, endpoint: str) -> list[Diagnosis]:
    """Run all trials at one router."""
    router = f"the router of {board}"
    try:
        async with _two(bus, endpoint) as (speaker, listener):
            there = await names_there(listener, mission.fleet)
            present = {f"{name}/{daemon}" for (_, name), its in there.items() for daemon in its}
            trials = _trials(mission, rights, board, present)
            done = await _try(speaker, listener, trials)
    except BusClosed as closed:
        return [Diagnosis("warning", WHAT, f"{router} cannot be reached, so its rules were not tried: {closed}")]
    wrong = [trial for trial in trials if trial.allowed != (trial in done)]
    may, may_not = sum(trial.allowed for trial in trials), sum(not trial.allowed for trial in trials)
    if not wrong:
        text = f"{router} allows {name} {may} of the tried actions and denies {may_not}, as the mission says"
        return [Diagnosis("ok", WHAT, text)]
    found = []
    do = f"write its configuration again (`argosy units MISSION --board {board}`) and restart its commd"
    for allowed, verb in ((True, "denies {}, against the mission, to"), (False, "allows {}, against the mission, to")):
        if these := [trial for trial in wrong if trial.allowed == allowed]:
            more = f", and {len(these) - 3} more" if len(these) > 3 else ""
            text = f"{router} {verb.format(name)} {', '.join(map(str, these[:3]))}{more}"
            found.append(Diagnosis("error", WHAT, text, do))
    return found


@asynccontextmanager
async def _two(bus: Bus, endpoint: str) -> AsyncIterator[tuple[Bus, Bus]]:
    """Open two sessions at a router. Raises BusClosed."""
    async with AsyncExitStack() as stack:
        one, other = [
            await stack.enter_async_context(
                open_bus(
                    endpoint,
                    fleet=bus.fleet,
                    name=bus.name,
                    daemon="argosy",
                    tls=bus.tls,
                    patience=PATIENCE,
                )
            )
            for _ in range(2)
        ]
        yield one, other


def _trials(mission: Mission, rights: Rights, at: str, present: Collection[str]) -> list[Trial]:
    """Return the trials at the router of a board: keys of the daemons, and queries of the agents, of each board.

    A query that a router forwards counts, at the next router, as one of the first router's board.
    """
    trials: list[Trial] = []
    passes_on = access_rules.of_board(mission, at)
    homes = mission.mailboxes | {name: robot.board for name, robot in mission.robots.items()}

    def add(right: str, key: str) -> None:
        name = key.split("/")[2]
        allowed = _covers(getattr(rights, right), key)
        if right == "asks" and homes.get(name, name) != at:
            allowed = allowed and _covers(passes_on.asks, key)
        trials.append(Trial(right, key, allowed))

    fleet = mission.fleet
    for board in mission.board_names:
        senders = [name for name, home in mission.mailboxes.items() if home == board][:1]
        robots = mission.robots_on(board)[:1]
        perceivers = [agent for robot in robots for agent in mission.agents_of(robot)][:1]
        receivers = [name for name, home in mission.mailboxes.items() if f"{home}/commd" in present][:1]
        for agent in perceivers:
            for right, key in (("puts", keys.percept), ("puts", keys.status), ("serves", keys.percept)):
                add(right, key(fleet, agent, "trial"))
            if f"{robots[0]}/bridged" in present:
                add("asks", keys.action(fleet, agent, "*"))
                add("asks", keys.cancel(fleet, agent))
        for robot in robots:
            add("puts", keys.manifest(fleet, robot))
            if f"{robot}/bridged" in present:
                add("asks", keys.stop(fleet, robot))
                add("asks", keys.manifest(fleet, robot))
        for name in senders:
            add("puts", keys.health(fleet, name, "argosy"))
            for receiver in receivers:
                add("asks", keys.mail(fleet, receiver, name))
            if f"{name}/agentd" in present:
                add("asks", keys.mind(fleet, name))
            if f"{board}/commd" in present:
                add("asks", keys.outbox(fleet, name))
        add("puts", keys.services(fleet, board))
        # For the board only: a bridge takes any token of its agent for the agent, even after it was lost in flight.
        add("holds", keys.alive(fleet, board, "argosy", "trial"))
        if f"{board}/commd" in present:
            add("asks", keys.mailboxes(fleet, board))
            add("asks", keys.services(fleet, board))
    return trials


def _covers(rules: Sequence[str], key: str) -> bool:
    asked = zenoh.KeyExpr(key)
    return any(zenoh.KeyExpr(rule).includes(asked) for rule in rules)


async def _try(speaker: Bus, listener: Bus, trials: Sequence[Trial]) -> set[Trial]:
    """Run the trials. Returns those that succeeded."""
    by_right = {right: [trial for trial in trials if trial.right == right] for right in RIGHTS}

    def of(right: str) -> tuple[list[str], list[str]]:
        some = by_right[right]
        return [trial.key for trial in some if trial.allowed], [trial.key for trial in some if not trial.allowed]

    (puts, no_puts), (serves, no_serves) = of("puts"), of("serves")
    answering = asyncio.gather(*(_answered(speaker, trial) for trial in by_right["asks"]))
    put, served, held, answers = await asyncio.gather(
        which_come_through(speaker.raw, listener.raw, puts, PATIENCE, no_puts),
        which_are_answered(listener.raw, speaker.raw, serves, PATIENCE, no_serves),
        _held(speaker, listener, by_right["holds"]),
        answering,
    )
    asked = {trial.key for trial, answered in zip(by_right["asks"], answers, strict=True) if answered}
    done = {"puts": put, "serves": served, "asks": asked, "holds": held}
    return {trial for trial in trials if trial.key in done[trial.right]}


async def _answered(bus: Bus, trial: Trial) -> bool:
    """Query without a record: a server of the key answers at least with an error. Repeat once if it is allowed."""
    return await bus.raw.answers(trial.key, PATIENCE) or (trial.allowed and await bus.raw.answers(trial.key, PATIENCE))


async def _held(speaker: Bus, listener: Bus, trials: Sequence[Trial]) -> set[str]:
    """Declare tokens and return those that the other session sees."""
    if not trials:
        return set()
    own = {f"{trial.key}-{os.urandom(4).hex()}": trial for trial in trials}
    tokens = [speaker.token(key) for key in own]
    loop = asyncio.get_running_loop()
    until = loop.time() + PATIENCE
    try:
        while True:
            seen = set(await listener.tokens(f"{keys.ROOT}/{speaker.fleet}/*/alive/argosy/*"))
            if loop.time() >= until or all(key in seen for key, trial in own.items() if trial.allowed):
                return {own[key].key for key in seen if key in own}
            await asyncio.sleep(0.05)
    finally:
        for token in tokens:
            speaker.withdraw(token)


CALL_PATIENCE = 3.0
"""Wall seconds for a TLS handshake with a board."""
RENEW = "on the machine with the fleet's keys: `argosy keys renew`, then copy the folder and restart commd"

UNBELIEVED = (
    "if boards were added (`argosy keys add-board`), copy this machine's new ca.pem here; else that board is revoked, "
    "or has keys of another fleet"
)


def certificates(mission: Mission, folder: Path | None) -> list[Diagnosis]:
    """Check this machine's certificate and those that the boards present. Does nothing without keys."""
    if folder is None:
        return []
    tls, now = files_in(Path(folder)), time.time()
    try:
        own = identity_of(tls, now)
    except Findings as findings:
        return [
            Diagnosis("error", "certificates", one.message, "see docs/guides/security.md") for one in findings.findings
        ]
    found = _dates("this machine's", own, now)
    seen = [own.ends]
    for board, entry in mission.boards.items():
        if not entry.address:
            continue
        try:
            theirs = shown_at(tls, *host_and_port(entry.address, DEFAULT_PORT))
        except ssl.SSLCertVerificationError as error:
            text = f"{board} presents one at {entry.address} that our ca.pem does not accept: {error.verify_message}"
            found.append(Diagnosis("error", "certificates", text, UNBELIEVED))
            continue
        except OSError as error:
            text = f"{board} presents none at {entry.address}: {error.strerror or error}"
            do = f"is {board} running, with its keys?"
            found.append(Diagnosis("error", "certificates", text, do))
            continue
        seen.append(theirs.ends)
        if theirs.name != board:
            text = f"`{theirs.name}` answers for {board} at {entry.address}"
            found.append(
                Diagnosis("error", "certificates", text, "were the addresses or the keys of two boards swapped?")
            )
        found += _dates(f"{board}'s", theirs, now)
    if not found:
        text = f"{count(len(seen), 'certificate')}, the first ends on {day(min(seen))}"
        found.append(Diagnosis("ok", "certificates", text))
    return found


def shown_at(tls: Tls, host: str, port: int) -> Identity:
    """Connect to the TCP `port` of a board; return its certificate's identity, valid or expired. Raises OSError."""
    with (
        socket.create_connection((host.strip("[]"), port), CALL_PATIENCE) as plain,
        shown_by(plain, tls) as (theirs, _),
    ):
        return theirs


def _dates(whose: str, identity: Identity, now: float) -> list[Diagnosis]:
    if now < identity.begins:
        text = f"{whose} certificate: {out_of_date(identity, now)}"
        return [Diagnosis("error", "certificates", text, "compare the clocks: every other machine refuses it")]
    if identity.ends - now > SOON:
        return []
    left = (identity.ends - now) / 86_400
    text = f"{whose} certificate (`{identity.name}`) ends on {day(identity.ends)}, in {left:.0f} days"
    if left <= 0:
        text = f"{whose} certificate (`{identity.name}`) expired on {day(identity.ends)}: other machines refuse it"
    return [Diagnosis("warning" if left > 0 else "error", "certificates", text, RENEW)]
