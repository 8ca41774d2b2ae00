"""A link over which nothing is known of what its board serves is renewed; that of a slow or foreign router is not."""

import asyncio
import os
import select
import signal
import socket
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack, ExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import pytest
import zenoh

from commd.bus.bus import Bus
from commd.bus.session import session_config, session_id
from commd.router import link_watchdog
from commd.router.link_watchdog import PATIENCE, PATIENCE_MOST, RENEWED, SCAN, UNLISTED, LinkWatchdog
from schemas.wire import keys
from schemas.wire.records import Receipt
from tests.attacks.world import NAME, TEXT, World, ask
from tests.support.buses import FLEET, session, under_way, until
from tests.support.notes import identities
from tests.support.ports import free_port
from tests.support.relay import Relay
from tests.support.secured import Secured

TRIES = 30
"""Times that a fault which a race makes is tried at most."""


@dataclass
class Fleet:
    """The routers of boards `a` and `b`; `b` dials `a` through a relay, and so does a third board."""

    a: Bus
    b: Bus
    to_b: Relay
    to_c: Relay

    @property
    def link(self) -> tuple[str, str, str] | None:
        """The link of `b` to `a`, if there is one now."""
        return next((one for one in self.b.link_ends() if one[0] == self.a.zid), None)

    async def hears(self) -> bool:
        """Whether `b` knows what `a` serves."""
        return bool(await self.b.tokens(keys.alive(FLEET, "a", "commd", "*")))

    async def answered(self) -> bool:
        """Whether `a` answers a query of `b`."""
        return await ask(self.b, "served", None, Receipt) == [Receipt()]

    async def renewed(self, before: object) -> None:
        await until(lambda: self.link not in (before, None), "the link is made again")

    async def become_deaf(self) -> None:
        """Lose and make again the links of `a` within one round of its router, until `b` has forgotten `a` by it."""
        for _ in range(TRIES):
            before = self.link
            self.to_c.reset()
            await asyncio.sleep(0.01)
            self.to_b.reset()
            await self.renewed(before)
            await asyncio.sleep(0.3)  # in which comes what comes with a link
            if not await self.hears():
                return
        raise AssertionError(f"the fault did not come in {TRIES} tries")


@asynccontextmanager
async def boards() -> AsyncIterator[Fleet]:
    """The fleet; the router of `a` closes connections that Zenoh holds without a link after a reset."""
    async with AsyncExitStack() as stack, asyncio.timeout(280):
        enter = stack.enter_async_context
        port = free_port()
        a = await enter(session(f"tcp/127.0.0.1:{port}", "a", "commd", router=True))
        relays = [await enter(Relay(free_port(), port)) for _ in range(2)]
        b, c = [
            await enter(
                session(
                    f"tcp/127.0.0.1:{free_port()}", name, "commd", router=True, connect=[f"tcp/127.0.0.1:{to.port}"]
                )
            )
            for name, to in zip("bc", relays, strict=True)
        ]
        for one in (a, b, c):
            await one.claim(one.name)
        await enter(under_way(LinkWatchdog(a, [], [a.endpoint]).run()))
        fleet = Fleet(a, b, *relays)
        await until(fleet.hears, "b hears a")
        yield fleet


async def test_a_board_that_is_linked_and_not_heard_is_heard_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(link_watchdog, "LOOK", 0.05)
    monkeypatch.setattr(link_watchdog, "PATIENCE", 0.3)
    monkeypatch.setattr(link_watchdog, "UNLISTED", 3.0)
    monkeypatch.setattr(link_watchdog, "SCAN", 0.5)
    async with boards() as fleet:
        fleet.a.serve("served", Receipt, lambda query: query.reply(Receipt()))
        renewals = 0
        for _ in range(TRIES):
            await fleet.become_deaf()
            deaf = not await fleet.answered()
            watchdog = LinkWatchdog(fleet.b, ["a", "c"], [])
            async with under_way(watchdog.run()):
                await until(fleet.hears, "b hears a again")
            await until(fleet.answered, "a answers, to which b may have no route for 0.1 s more")
            if not deaf or not watchdog.counters["links_renewed"]:
                continue  # a busy machine was only late to hear it
            assert identities(watchdog.health().notes) == [(RENEWED, "a")]
            renewals += 1
            if renewals == 3:
                break
        assert renewals == 3


class OneLink:
    """A router's session with one TCP connection, which is its link to board `b` while `listed`."""

    fleet, listed, token = FLEET, True, staticmethod(lambda *_: None)

    def __init__(self, stack: ExitStack) -> None:
        self._enter = stack.enter_context
        self._listening = self._enter(socket.create_server(("127.0.0.1", 0)))
        self.endpoint = "tcp/{}:{}".format(*self._listening.getsockname())
        self.dial()

    def dial(self) -> None:
        self._theirs = self._enter(socket.create_connection(self._listening.getsockname(), 60))
        self._ours = self._enter(self._listening.accept()[0])

    def is_closed(self) -> bool:
        readable, _, _ = select.select([self._theirs], [], [], 0)
        return bool(readable)

    def watch(self, key: str, handler: Callable[[str, bool], None]) -> None:
        self.token = handler

    def link_ends(self) -> list[tuple[str, str, str]]:
        ends = ("tcp/{}:{}".format(*name) for name in (self._ours.getsockname(), self._theirs.getsockname()))
        return [(session_id("b"), *ends)] if self.listed else []


def watched(stack: ExitStack) -> tuple[OneLink, LinkWatchdog]:
    link = OneLink(stack)
    return link, LinkWatchdog(cast(Bus, link), ["b"], ["unixsock-stream//a", f"{link.endpoint}#iface=lo"])


def test_a_board_that_stays_silent_is_linked_anew_ever_more_seldom() -> None:
    with ExitStack() as stack:
        link, watchdog = watched(stack)
        now, patience = 0.0, PATIENCE
        for renewals in range(9):
            watchdog.look(now)
            watchdog.look(now + patience - 0.1)
            assert not link.is_closed()
            watchdog.look(now := now + patience)
            assert link.is_closed()
            assert watchdog.counters["links_renewed"] == renewals + 1
            link._ours.close()
            link.dial()
            patience = min(2 * patience, PATIENCE_MOST)
        watchdog.look(now)
        link.token(keys.alive(FLEET, "b", "commd", "b"), True)
        for _ in range(3):
            watchdog.look(now := now + patience)
        assert not link.is_closed()


def test_a_connection_that_zenoh_holds_without_a_link_is_closed() -> None:
    with ExitStack() as stack:
        link, watchdog = watched(stack)
        another = OneLink(stack)  # a connection at a port that is not of the router
        link.token(keys.alive(FLEET, "b", "commd", "b"), True)
        link.listed = False
        began = time.monotonic()
        for later in range(4):
            link.listed = later == 2
            watchdog.look(began + later * SCAN)
        watchdog.look(began + 3 * SCAN + UNLISTED - 0.1)
        assert not link.is_closed()
        watchdog.look(began + 4 * SCAN + UNLISTED)
        assert link.is_closed()
        watchdog.look(began + 9 * UNLISTED)
        assert identities(watchdog.health().notes) == [(RENEWED, "127.0.0.1")]
        assert not another.is_closed()


async def test_a_router_that_is_slow_or_no_board_keeps_its_link() -> None:
    port = free_port()
    foreign = session_config("router", f"tcp/127.0.0.1:{free_port()}", "zenohd", connect=[f"tcp/127.0.0.1:{port}"])
    async with (
        session(f"tcp/127.0.0.1:{port}", "a", "commd", router=True) as a,
        session(f"tcp/127.0.0.1:{free_port()}", "b", "commd", router=True, connect=[f"tcp/127.0.0.1:{port}"]) as slow,
    ):
        watchdog = LinkWatchdog(a, ["b"], [])
        with await asyncio.to_thread(zenoh.open, foreign):
            await until(lambda: len(a.link_ends()) == 2, "both are linked")
            before = sorted(a.link_ends())
            watchdog.look(0.0)
            watchdog.look(PATIENCE - 0.1)
            await slow.claim("b")
            await until(lambda: bool(watchdog._tokens.get("b")), "the watchdog hears b")
            watchdog.look(PATIENCE)
            watchdog.look(10 * PATIENCE_MOST)
            assert sorted(a.link_ends()) == before
            assert not watchdog.counters


async def test_a_link_that_is_no_tcp_connection_is_not_judged(tmp_path: Path) -> None:
    place = f"unixsock-stream/{tmp_path}/a.sock"
    async with (
        session(f"tcp/127.0.0.1:{free_port()}", "a", "commd", router=True, listen=[place]) as a,
        session(f"tcp/127.0.0.1:{free_port()}", "b", "commd", router=True, connect=[place]),
    ):
        watchdog = LinkWatchdog(a, ["b"], [])
        await until(lambda: a.link_ends() != [], "b is linked")
        for now in (0.0, PATIENCE, 10 * PATIENCE_MOST):
            watchdog.look(now)
        assert not watchdog.counters


def test_a_board_that_stood_still_for_longer_than_its_lease_takes_mail_again() -> None:
    with Secured(TEXT) as fleet:
        world = World(fleet)
        fleet.routers()
        stopped = fleet.daemons[1]

        async def body() -> None:
            async with world.member("pi1", "a") as pi1, world.member("pi3", "c") as pi3, asyncio.timeout(150):
                for _ in range(3):
                    for member, name in ((pi1, "a"), (pi3, "c")):
                        await until(_answers(member, keys.mail(NAME, "b", name)), f"{name} reaches b")
                    stopped.signal(signal.SIGSTOP)
                    try:
                        for member in (pi1, pi3):
                            await until(_hides(member, "pi2"), "pi2 is given up")
                        await asyncio.sleep(1.5)  # in which they dial, and wait for it to answer
                    finally:
                        stopped.signal(signal.SIGCONT)
                for member, name in ((pi1, "a"), (pi3, "c")):
                    await until(_answers(member, keys.mail(NAME, "b", name)), f"{name} reaches b at last")

        asyncio.run(body())


def _hides(bus: Bus, board: str) -> Callable[[], Awaitable[bool]]:
    async def hidden() -> bool:
        return not await bus.tokens(keys.alive(bus.fleet, board, "commd", "*"))

    return hidden


def _answers(bus: Bus, key: str) -> Callable[[], Awaitable[bool]]:
    async def answered() -> bool:
        return bool(await ask(bus, key, None, Receipt))

    return answered


def test_a_scan_of_all_files_passes_over_those_that_are_no_connection_of_ip_and_leaves_none_open() -> None:
    with ExitStack() as stack:
        stack.enter_context(socket.socket(socket.AF_NETLINK, socket.SOCK_RAW))
        stack.enter_context(socket.socketpair()[0])
        link = OneLink(stack)
        before = os.listdir("/proc/self/fd")
        found = [ends for _, ends in link_watchdog._connections()]
        assert {link_watchdog._ends(*ends) for _, *ends in link.link_ends()} <= set(found)
        assert os.listdir("/proc/self/fd") == before
