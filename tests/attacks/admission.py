"""Attacks on a board's listener: floods of connections, and sessions that carry another machine's Zenoh id."""

import asyncio
import json
import signal
import socket
import ssl
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress

import zenoh

from argosy.__main__ import main as argosy
from commd.bus.bus import Bus
from commd.bus.connect_diagnosis import why_not
from commd.bus.session import owner_of, session_config
from commd.router.admission import FORGED, KNOWN_LISTENERS, KNOWN_REFILL
from tests.attacks.world import Attack, Row, World, attack, health_of
from tests.support.buses import until
from tests.support.promises import in_time

BURST = 1500
"""Connections, as fast as they can be made."""
FLOOD = 6.0
"""Seconds that connections and handshakes go on to come."""
HALF_OPEN_RATE, HANDSHAKE_RATE = 100.0, 50.0
"""Connections that say nothing, and handshakes without a certificate, each second."""
CONFIRMED = 3.0
"""Seconds in which an order to stop is to be confirmed."""
BACK = 5.0
"""Seconds in which who lost its session is to have it again."""
OPERATORS, ELSEWHERE, FURTHER = "127.0.0.1", "127.0.0.66", "127.0.0.67"
"""The address of operators and boards, and those of attackers."""
IN_A_ROW = 6
"""Orders to stop, one after another."""
HALF_OPEN, HANDSHAKES = "half-open connections", "handshakes without a certificate"


@attack(
    "a flood of connections without a certificate",
    f"{BURST} simultaneous TCP connections from an operator's own address; then for {FLOOD:g} s from others "
    f"{HALF_OPEN_RATE:g} half-open ones and {HANDSHAKE_RATE:g} TLS handshakes without a certificate each second; "
    "`argosy stop hold r1` before, during and after",
    "commd of pi1: a connection without a ClientHello does not reach the router; 10 failed handshakes an address, 2 a "
    "second; addresses that are known have listeners of their own",
)
async def connect_flood(row: Row, world: World) -> None:
    """Connections of whoever has no certificate: a burst, then half-open ones and failing handshakes that go on."""
    took = {"before": await _stop(row, world, "before")}
    began = time.monotonic()
    await asyncio.to_thread(_burst, world.fleet.ports["pi1"])
    burst = time.monotonic() - began
    took["right after the burst"] = await _stop(row, world, "right after the burst")
    with _flooding(world.fleet.ports["pi1"]) as made:
        await until(lambda: min(made.values()) >= HANDSHAKE_RATE, "the flood goes on")
        took["in the flood"] = await _stop(row, world, "in the flood")
        row.expect(await why_not(world.fleet.link("pi1"), world.fleet.tls("ops")) == "", "the diagnosis finds no fault")
    took["after it"] = await _stop(row, world, "after it")
    await _stop(row, world, "once more", "release")
    times = ", ".join(f"{seconds:.1f} s {when}" for when, seconds in took.items())
    row.seen.append(f"`argosy stop` confirmed in {times}; the burst took {burst:.1f} s")
    made_in_all = ", ".join(f"{count} {what}" for what, count in made.items())
    row.seen.append(f"flood: {made_in_all}")


@attack(
    "failing handshakes from an operator's own address",
    f"three clients at the operator's address with up to {HANDSHAKE_RATE:g} TLS handshakes without a certificate "
    f"each second; `argosy stop hold r1` {IN_A_ROW} times meanwhile",
    f"commd: known addresses share {KNOWN_REFILL:g} failing handshakes a second beyond their own 2, and have "
    f"{KNOWN_LISTENERS} listeners, of which a failing handshake stops one for 0.1 s",
)
async def handshakes_beside_the_operator(row: Row, world: World) -> None:
    """Handshakes that fail, from the address that operators and boards have: of the same machine, or behind one NAT."""
    before = await _stop(row, world, "before")
    with _flooding(world.fleet.ports["pi1"], half_open="", handshakes=OPERATORS, seconds=IN_A_ROW * CONFIRMED) as made:
        await until(lambda: made[HANDSHAKES] >= HANDSHAKE_RATE, "the flood goes on")
        began, first = time.monotonic(), made[HANDSHAKES]
        took = [await _stop(row, world, f"in the flood, order {number}") for number in range(1, IN_A_ROW + 1)]
        rate = (made[HANDSHAKES] - first) / (time.monotonic() - began)
    await _stop(row, world, "once more", "release")
    row.expect(rate > HANDSHAKE_RATE / 2, f"the flood is one: {rate:.0f} a second")
    row.seen.append(f"`argosy stop` confirmed in {before:.1f} s before, at most {max(took):.1f} s in the flood")
    row.seen.append(f"{rate:.0f} handshakes without a certificate a second meanwhile")


@attack(
    "another machine's Zenoh id",
    "`eye` opens sessions at pi1 under the ids of pi2's router while its link is lost, of an operator's session "
    "between two, and of pi1's own bridge while commd of pi1 is started again, and goes on all the while",
    "commd of pi1: ids say whose they are, and a session with another's is cut off",
)
async def forged_session_id(row: Row, world: World) -> None:
    """A machine opens sessions under the Zenoh ids of a board that was away for a moment, and of an operator."""
    async with world.machine("ops", "pi1") as ops:
        operators = ops.zid
    with _under(world, operators):
        began = time.monotonic()
        config = session_config("client", world.fleet.link("pi1"), "ops", tls=world.fleet.tls("ops"))
        config.insert_json5("id", json.dumps(operators))
        opened = await asyncio.to_thread(_opens_within, config, BACK)
        row.expect(opened, "the operator's session is there again")
        row.seen.append(f"an operator's session is back in {time.monotonic() - began:.1f} s")
    async with world.member("pi1") as member:
        pi2 = world.commd["pi2"]
        its = [zid for zid in await _ids(member) if owner_of(zid, ["pi2"]) == "pi2"]
        row.expect(len(its) == 1, "pi2 is linked")
        pi2.signal(signal.SIGSTOP)
        try:
            await _until_ids(member, lambda ids: its[0] not in ids)
            with _under(world, *its):
                await asyncio.sleep(1.0)  # in which it may come in
                pi2.signal(signal.SIGCONT)
                began = time.monotonic()
                await health_of(member, "pi2", "commd")
                back = time.monotonic() - began
        finally:
            pi2.signal(signal.SIGCONT)
        row.expect(in_time(back, BACK), f"pi2 is linked again within {BACK:g} s, not {back:.1f} s")
        row.seen.append(f"pi2 is heard at pi1 {back:.1f} s after its network is back")
        health = await health_of(member, "pi1", "commd")
        row.expect(FORGED in {note.code for note in health.notes}, "health has the security event")
        event = next((line for line in world.commd["pi1"].lines if f"event={FORGED}" in line), "")
        row.seen.append(f"health of pi1: code `{FORGED}`, {health.counters.get(FORGED, 0):g} times; its log: `{event}`")
        daemons = [zid for zid in await _ids(member) if owner_of(zid, []) == "" and zid != member.zid]
    world.commd["pi1"].kill()
    with _under(world, *daemons):
        await asyncio.sleep(0.5)
        world.commd["pi1"] = world.fleet.start("pi1", "commd")
        world.commd["pi1"].says("router board=")
        began = time.monotonic()
        async with world.member("pi1") as member:
            await health_of(member, "r1", "bridged")
        back = time.monotonic() - began
    row.expect(in_time(back, BACK), f"the bridge is back within {BACK:g} s, not {back:.1f} s")
    row.seen.append(f"the bridge of r1 is heard {back:.1f} s after commd of pi1 serves again")


async def _stop(row: Row, world: World, when: str, order: str = "hold") -> float:
    """Order `argosy stop hold r1` as the operator does, and return the seconds until it is confirmed."""
    words = ["stop", order, "r1", "--mission", str(world.fleet.path), "--keys", str(world.fleet.keys("ops"))]
    began = time.monotonic()
    code = await asyncio.to_thread(argosy, words)
    took = time.monotonic() - began
    row.expect(code == 0, f"`argosy stop` is confirmed {when}")
    row.expect(in_time(took, CONFIRMED), f"it is confirmed within {CONFIRMED:g} s {when}, not in {took:.1f} s")
    return took


def _burst(port: int) -> None:
    for _ in range(BURST):
        socket.create_connection(("127.0.0.1", port), 5).close()


@contextmanager
def _flooding(
    port: int, half_open: str = ELSEWHERE, handshakes: str = FURTHER, seconds: float = FLOOD
) -> Iterator[dict[str, int]]:
    """Connect without a word, and shake hands without a certificate, from these addresses ("" = not at all) for some
    seconds; yields how often."""
    made = {HALF_OPEN: 0, HANDSHAKES: 0}
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    until_then, over = time.monotonic() + seconds, threading.Event()

    def say_nothing() -> None:
        with ExitStack() as held:
            while time.monotonic() < until_then and not over.wait(1 / HALF_OPEN_RATE):
                held.enter_context(socket.create_connection(("127.0.0.1", port), 5, (half_open, 0)))
                made[HALF_OPEN] += 1

    def shake_hands() -> None:
        while time.monotonic() < until_then and not over.wait(1 / HANDSHAKE_RATE):
            with (
                suppress(OSError),
                socket.create_connection(("127.0.0.1", port), 5, (handshakes, 0)) as connection,
                context.wrap_socket(connection) as session,
            ):
                session.settimeout(1.0)
                session.recv(1)
            made[HANDSHAKES] += 1

    works = [*([say_nothing] if half_open else []), shake_hands, shake_hands, shake_hands]
    threads = [threading.Thread(target=work) for work in works]
    for thread in threads:
        thread.start()
    try:
        yield made
    finally:
        over.set()
        for thread in threads:
            thread.join(10)


@contextmanager
def _under(world: World, *ids: str) -> Iterator[None]:
    """Let `eye` have sessions with these ids at pi1, as soon and as often as it gets them, from another address."""
    over = threading.Event()

    def take(zid: str) -> None:
        place = f"{world.fleet.link('pi1')}#bind={ELSEWHERE}:0"
        config = session_config("client", place, "attack", tls=world.fleet.tls("eye"))
        config.insert_json5("id", json.dumps(zid))
        while not over.is_set():
            with suppress(zenoh.ZError), zenoh.open(config):  # it dials again by itself when it is cut off
                over.wait()

    threads = [threading.Thread(target=take, args=(zid,)) for zid in ids]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        over.set()
        for thread in threads:
            thread.join(15)


async def _ids(member: Bus) -> list[str]:
    """The ids of the sessions at a board's router."""
    answers = await member.raw.look_up("@/*/router", 2)
    return [str(session["peer"]) for answer in answers for session in json.loads(answer.payload)["sessions"]]


async def _until_ids(member: Bus, condition: Callable[[list[str]], bool]) -> None:
    async def holds() -> bool:
        return condition(await _ids(member))

    await until(holds, "the sessions at the router are as wished")


def _opens_within(config: zenoh.Config, seconds: float) -> bool:
    until_then = time.monotonic() + seconds
    while time.monotonic() < until_then:
        with suppress(zenoh.ZError), zenoh.open(config):
            return True
    return False


ADMISSION: tuple[Attack, ...] = (connect_flood, handshakes_beside_the_operator, forged_session_id)
