"""Keys that a session declares because it uses them again and again."""

from contextlib import AbstractAsyncContextManager, AsyncExitStack
from typing import Any

import pytest

from commd.bus import session
from commd.bus.bus import Bus, open_bus
from schemas.wire.records import Perception
from tests.support.buses import Connect, until

KEY = "argosy/test/uav/percept/altitude"


async def test_a_key_is_declared_when_it_is_used_again_and_no_more_than_there_is_room_for(
    connect: Connect, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(session, "MOST_KEYS", 3)
    bus = await connect()
    known = session.KeyCache(bus._session)
    assert known.of(KEY) == KEY
    assert known.used(KEY) is not None
    assert str(known.of(KEY)) == KEY
    assert known.of(KEY) is known.of(KEY)
    for number in range(10):
        assert known.of(f"seen/once/{number}") == f"seen/once/{number}"
    for other in ("a/b", "a/c"):
        assert known.of(other) == other
        assert known.of(other) is not other
    assert known.of("a/d") == known.of("a/d") == "a/d"
    assert known.of(KEY) is known.used(KEY), "what is declared stays so"
    assert [one.message for one in caplog.records if "keys_declared" in one.message] == [
        "keys_declared count=3: records on further keys cost more processor time"
    ]


async def test_what_is_no_key_is_not_declared(connect: Connect) -> None:
    known = session.KeyCache((await connect())._session)
    assert [known.of("//"), known.of("//"), known.of("//")] == ["//"] * 3


async def test_declared_keys_outlive_their_router(endpoint: str) -> None:
    def router(at: str) -> AbstractAsyncContextManager[Bus]:
        return open_bus(at, fleet="test", name="board", daemon="commd", mode="router")

    def client(name: str) -> AbstractAsyncContextManager[Bus]:
        return open_bus(endpoint, fleet="test", name=name, daemon="agentd")

    def heard(bus: Bus) -> list[Any]:
        got: list[Any] = []
        bus.subscribe("argosy/test/uav/percept/*", Perception, lambda key, record: got.append(record.parameters[0]))
        return got

    async def tell(bus: Bus, got: list[Any], begin: int, end: int) -> None:
        def knocked() -> bool:
            bus.put(KEY, Perception(name="altitude", parameters=("knock",)))
            return got[-1:] == ["knock"]

        await until(knocked, "this one is subscribed: others may have been before")
        for number in range(begin, end):
            bus.put(KEY, Perception(name="altitude", parameters=(number,)))
        await until(lambda: got[begin - end :] == list(range(begin, end)), "what is put arrives in order")

    async with AsyncExitStack() as clients:
        async with router(endpoint):
            sender, receiver = [await clients.enter_async_context(client(name)) for name in ("uav", "other")]
            got = heard(receiver)
            await tell(sender, got, 0, 5)
        await until(lambda: not sender.router_up and not receiver.router_up, "the router is gone")
        for number in range(5):
            sender.put(KEY, Perception(name="altitude", parameters=(f"lost {number}",)))
        async with router(endpoint):
            await until(lambda: sender.router_up and receiver.router_up, "the router is back")
            await tell(sender, got, 5, 10)
            late = await clients.enter_async_context(client("late"))
            of_late = heard(late)
            await tell(sender, of_late, 10, 15)
            await until(lambda: got[-5:] == of_late[-5:], "the others hear the same")
