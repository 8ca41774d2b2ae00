"""Attacks on the links: who is not of the fleet does not come in, and who is comes in as nobody else."""

import asyncio
import json
import socket
import time
from typing import Any

import zenoh

from argosy.__main__ import main as argosy
from commd.bus.bus import Bus
from commd.bus.connect_diagnosis import why_not
from commd.bus.session import session_config
from commd.bus.tls import Tls, files_in
from schemas.wire import keys
from schemas.wire.mind_records import MindView
from schemas.wire.records import BoardServices, LiveManifest, Outcome, Perception, Receipt, StopOrder
from tests.attacks.world import NAME, Attack, Row, World, ask, attack, health_of, letter, put_until
from tests.support.buses import until
from tests.support.ports import free_port

HALF_OPEN = 40


@attack("foreign CA", "certificates of another authority for `pi3`, dialled pi1", "pi1's router: TLS handshake")
async def foreign_authority(row: Row, world: World) -> None:
    """Somebody has made an authority of his own, with the same names."""
    folder = world.fleet.folder / "foreign"
    argosy(["keys", "init", str(world.fleet.path), "--dir", str(folder)])
    await _stays_out(row, world, files_in(folder / "machines" / "pi3"))


@attack("no certificate", "a TLS client that trusts the fleet and shows nothing", "pi1's router: TLS handshake")
async def no_certificate(row: Row, world: World) -> None:
    """Somebody believes the fleet's authority and shows no certificate."""
    settings = world.fleet.tls("pi3").settings()
    config = session_config("client", world.fleet.link("pi1"), "attack")
    config.insert_json5("transport/link/tls/root_ca_certificate", f'"{settings["root_ca_certificate"]}"')
    row.expect(not await asyncio.to_thread(_opens, config), "no session without a certificate")
    await _comes_in(row, world)
    row.seen.append("attacker: `Unable to connect`, without a reason")


@attack("plain TCP", "a Zenoh client by `tcp/` at pi1's port", "pi1's router: it speaks TLS alone")
async def plain_tcp(row: Row, world: World) -> None:
    """Somebody speaks Zenoh without TLS."""
    config = session_config("client", world.fleet.link("pi1").replace("tls/", "tcp/"), "attack")
    row.expect(not await asyncio.to_thread(_opens, config), "no session by plain TCP")
    await _comes_in(row, world)
    why = await why_not(world.fleet.link("pi1").replace("tls/", "tcp/"), None)
    row.seen.append(f"attacker: `Unable to connect`; Argosy's commands add: {why}")


@attack(
    "another board's certificate",
    "pi3's certificate from another place: puts on `b/percept/x` (pi2's agent) at pi1, holds `pi2/alive/..`",
    "pi1's router: access rules for `pi3`",
)
async def another_boards_certificate(row: Row, world: World) -> None:
    """A board speaks for another one's agent, at a third."""
    async with world.member("pi1") as listener, world.machine("pi3", "pi1") as attacker:
        attacker.token(keys.alive(NAME, "pi2", "commd", "feedbeef"))
        attacker.token(keys.alive(NAME, "c", "attack", "feedbeef"))
        row.expect(not await _hears_of_b(listener, attacker), "no percept of b from pi3")
        await until(lambda: listener.tokens(keys.alive(NAME, "c", "attack", "feedbeef")), "its own token is there")
        forged = await listener.tokens(keys.alive(NAME, "pi2", "commd", "feedbeef"))
        row.expect(not forged, "no token of pi2 from pi3")
        row.seen.append("what is pi3's own (`c/percept/x`, its token) arrived in the same second")


@attack("another board's keys on a board", "pi1's commd started with pi3's folder of keys", "commd of pi1, at start")
async def another_boards_keys_on_a_board(row: Row, world: World) -> None:
    """A board is given another one's folder of keys."""
    settings = world.fleet.settings("pi1")
    settings["transport"]["link"]["tls"] = world.fleet.tls("pi3").settings()
    settings["listen"]["endpoints"] = [f"unixsock-stream/{world.fleet.folder}/other.sock"]
    file = world.fleet.folder / "other.json5"
    file.write_text(json.dumps(settings))
    state = str(world.fleet.folder / "state" / "other")
    daemon = world.fleet.run(
        "commd", "serve", str(world.fleet.path), "--board", "pi1", "--config", str(file), "--state", state
    )
    row.expect(await asyncio.to_thread(daemon.ends) == 2, "commd ends with 2")
    printed = "the keys are those of `pi3`, and this is board `pi1`"
    row.expect(printed in daemon.text, f"it says `{printed}`: {daemon.text[-200:]}")
    row.seen.append(f"commd: ``{printed}``")


@attack(
    "a router in another board's place",
    "pi3's certificate listens where `pi2` is dialled, and serves pi2's mailbox and percepts",
    "the dialling router: access rules for who is really there",
)
async def impostor_router(row: Row, world: World) -> None:
    """A machine of the fleet listens where another board is expected."""
    port, folder = free_port(), world.fleet.folder
    settings = world.fleet.settings("pi1")
    settings["listen"]["endpoints"] = [f"unixsock-stream/{folder}/dialler.sock"]
    settings["connect"]["endpoints"] = [f"tls/127.0.0.1:{port}"]
    false = session_config("router", f"tls/127.0.0.1:{port}", "impostor", tls=world.fleet.tls("pi3"))
    with (
        await asyncio.to_thread(zenoh.open, false) as impostor,
        await asyncio.to_thread(zenoh.open, zenoh.Config.from_json5(json.dumps(settings))) as dialler,
    ):
        await until(lambda: bool(dialler.info.routers_zid()), "the dialler is linked")
        with (
            impostor.declare_queryable(keys.mail(NAME, "b", "*"), zenoh.handlers.FifoChannel(8)),
            impostor.declare_queryable(keys.mail(NAME, "c", "*"), zenoh.handlers.FifoChannel(8)),
        ):
            heard: list[str] = []
            with dialler.declare_subscriber(f"argosy/{NAME}/*/percept/*", lambda s: heard.append(str(s.key_expr))):
                own, forged = keys.percept(NAME, "c", "x"), keys.percept(NAME, "b", "x")

                def arrives() -> bool:
                    impostor.put(forged, b"1")
                    impostor.put(own, b"1")
                    return own in heard

                await until(arrives, "its own percept arrives")
                row.expect(forged not in heard, "b's percept does not")
                with (
                    dialler.declare_querier(keys.mail(NAME, "b", "a")) as to_b,
                    dialler.declare_querier(keys.mail(NAME, "c", "a")) as to_c,
                ):
                    await until(lambda: _matching(to_c), "what it may serve is known")
                    row.expect(not _matching(to_b), "b's mailbox is not known from there")
    row.seen.append("no mail for `b` goes there: nobody serves it; the lane says `pi2 is away`")


@attack(
    "by way of a third board",
    "a member of pi3 puts on `b/percept/x` and asks `b/mail/a` at pi3's own socket",
    "pi3's own router: rules for its members",
)
async def stolen_relay(row: Row, world: World) -> None:
    """A board hands what it says in another's name to a third one, to be passed on."""
    async with world.member("pi1") as listener, world.member("pi3") as attacker:
        row.expect(not await _hears_of_b(listener, attacker), "no percept of b by way of pi3")
        row.expect(await ask(attacker, keys.mail(NAME, "b", "a"), letter("a", "b"), Receipt) == [], "no receipt")
    row.seen.append("attacker: no reply, and no report: Zenoh drops silently what its rules deny")


@attack(
    "a router's own settings",
    "pi3 asks `@/*/router` of pi1; a member of pi1 puts on `@/*/router/config/**` and lists `@/*/router/token/**`",
    "pi1's router: rules, and `adminspace.permissions.write: false`",
)
async def admin_space(row: Row, world: World) -> None:
    """A machine asks a router for what it knows, and changes its configuration."""
    async with world.machine("pi3", "pi1") as attacker, world.member("pi1") as member:
        row.expect(await attacker.raw.look_up("@/*/router", 2) == [], "a board learns nothing of another's router")
        mine = await member.raw.look_up("@/*/router", 2)
        row.expect(mine, "a member may ask")
        zid = mine[0].key.split("/")[1]
        row.expect(await member.raw.look_up(f"@/{zid}/router/token/**", 2) == [], "and lists nothing")
        member._session.put(f"@/{zid}/router/config/access_control/enabled", "false")
        row.expect(not await _hears_of_b(member, attacker), "access control is still there")
    row.seen.append("pi3: no reply; after the put the rules hold as before")


@attack(
    "an observer or operator who does more",
    "`eye` asks `r1/stop`, `c/mail/a`, lists mailboxes and puts; `ops` puts a percept",
    "pi1's router: rules for observers and operators",
)
async def people(row: Row, world: World) -> None:
    """An observer acts, an operator perceives for an agent."""
    stop = StopOrder(order="hold")
    async with world.machine("eye", "pi1") as eye, world.machine("ops", "pi1") as ops, world.member("pi1") as member:
        row.expect(await ask(eye, keys.stop(NAME, "r1"), stop, Outcome) == [], "an observer stops nothing")
        row.expect(await ask(eye, keys.manifest(NAME, "r1"), None, LiveManifest) == [], "and reads no manifest")
        row.expect(await ask(eye, keys.mail(NAME, "c", "a"), letter("a", "c"), Receipt) == [], "and sends no mail")
        row.expect(len(await ask(eye, keys.services(NAME, "*"), None, BoardServices)) == 3, "it sees three boards")
        row.expect(len(await ask(ops, keys.stop(NAME, "r1"), stop, Outcome)) == 1, "the operator stops the robot")
        await ask(ops, keys.stop(NAME, "r1"), StopOrder(order="release"), Outcome)
        heard: list[str] = []
        member.subscribe(keys.percept(NAME, "*", "*"), Perception, lambda key, _: heard.append(key))
        for person in (eye, ops):
            person.put(keys.percept(NAME, "a", "x"), Perception(name="x", header=person.header("x")))
        async with world.machine("pi3", "pi1") as board:
            await put_until(board, heard, keys.percept(NAME, "a", "x"), keys.percept(NAME, "c", "x"))
        row.expect(keys.percept(NAME, "a", "x") not in heard, "neither puts a percept")
        row.expect(await ask(eye, keys.mind(NAME, "a"), None, MindView) == [], "nobody serves a mind here")
    row.seen.append("eye: no replies, but three boards' services; ops: the robot's `Outcome`")


@attack(
    "many half-open connections",
    f"{HALF_OPEN} silent TCP connections to pi1's port",
    "commd of pi1: a connection without a ClientHello within 5 s is closed, and never reaches the router",
)
async def half_open(row: Row, world: World) -> None:
    """Connections that never say who they are."""
    knocks = [socket.create_connection(("127.0.0.1", world.fleet.ports["pi1"]), 5) for _ in range(HALF_OPEN)]
    try:
        async with world.member("pi1") as member:
            began = time.monotonic()
            health = await health_of(member, "pi2", "commd")
            row.expect(health.daemon == "commd", "links that are there go on")
            row.seen.append(f"health of pi2 at pi1 after {time.monotonic() - began:.1f} s; members come in meanwhile")
    finally:
        for knock in knocks:
            knock.close()
    began = time.monotonic()
    await _comes_in(row, world, patience=30)
    took = time.monotonic() - began
    row.seen.append(f"pi3 connects again {took:.1f} s after them")


async def _stays_out(row: Row, world: World, tls: Tls) -> None:
    config = session_config("client", world.fleet.link("pi1"), "attack", tls=tls)
    row.expect(not await asyncio.to_thread(_opens, config), "no session opens")
    row.seen.append(
        f"attacker: `Unable to connect`; Argosy's commands add: {await why_not(world.fleet.link('pi1'), tls)}"
    )
    await _comes_in(row, world)


async def _comes_in(row: Row, world: World, patience: float = 5) -> None:
    """That who may come in does, shows that the attack was refused for what it was."""
    async with world.machine("pi3", "pi1", patience=patience) as good:
        row.expect(await ask(good, keys.services(NAME, "pi1"), None, BoardServices), "pi3 itself is let in")


async def _hears_of_b(listener: Bus, attacker: Bus) -> bool:
    """Put a percept of `b`, which is another board's, and pi3's own of `c` until that arrives. Returns whether the
    former has arrived, too."""
    heard: list[str] = []
    listener.subscribe(keys.percept(NAME, "*", "*"), Perception, lambda key, _: heard.append(key))
    await put_until(attacker, heard, forged := keys.percept(NAME, "b", "x"), keys.percept(NAME, "c", "x"))
    return forged in heard


def _matching(querier: Any) -> bool:
    """Whether somebody serves what a querier asks."""
    return bool(querier.matching_status.matching)


def _opens(config: zenoh.Config) -> bool:
    try:
        with zenoh.open(config):
            return True
    except zenoh.ZError:
        return False


LINKS: tuple[Attack, ...] = (
    foreign_authority,
    no_certificate,
    another_boards_certificate,
    another_boards_keys_on_a_board,
    impostor_router,
    plain_tcp,
    stolen_relay,
    admin_space,
    people,
    half_open,
)
