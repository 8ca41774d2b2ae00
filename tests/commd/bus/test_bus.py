"""The bus over real Zenoh sessions and a real router."""

import asyncio
import threading
import time
from collections.abc import Awaitable, Callable, Coroutine, Sequence
from contextlib import AsyncExitStack, aclosing
from inspect import CORO_CLOSED, getcoroutinestate
from typing import Any, cast
from unittest.mock import Mock

import pytest
import zenoh

from commd.bus.bus import Bus, Query, open_bus
from commd.bus.errors import AccessDenied, AlreadyRunning, BusClosed, QueryFailed, QueryTimeout
from commd.bus.queries import ROUTER_LOST
from schemas.wire.codec import codec
from schemas.wire.records import Action, ActionStatus, Perception
from tests.support.buses import Connect, served, subscribed, until, virtual_bus_test
from tests.support.processes import poll

PERCEPT, ACTION = "argosy/test/uav/percept/a", "argosy/test/uav/action/land"


async def perceived(connect: Connect) -> tuple[Bus, Bus, list[tuple[str, Perception]]]:
    """One who puts the percept, one who hears of it, and what that one has heard."""
    sender, receiver, got = await connect(), await connect(), list[tuple[str, Perception]]()
    receiver.subscribe("argosy/test/uav/percept/*", Perception, lambda key, record: got.append((key, record)))
    await subscribed(sender, PERCEPT)
    return sender, receiver, got


async def serving(
    connect: Connect, serve: Callable[[Query[Action]], Awaitable[None]], **options: Any
) -> tuple[Bus, Bus]:
    """One who serves actions, and one who may ask for them."""
    server, asker = await connect(), await connect()
    server.serve("argosy/test/uav/action/*", Action, serve, **options)
    await served(asker, ACTION)
    return server, asker


async def test_what_is_put_arrives_typed_and_in_order(connect: Connect) -> None:
    sender, _, got = await perceived(connect)
    for altitude in range(50):
        sender.put(PERCEPT, Perception(name="a", parameters=(altitude,)))
    await until(lambda: len(got) == 50, "what was sent arrives")
    assert [(key, record.parameters) for key, record in got] == [(PERCEPT, (n,)) for n in range(50)]


@pytest.mark.parametrize("told", [True, False], ids=["told to stop", "left waiting"])
async def test_a_session_not_opened_in_time_does_not_keep_a_daemon(told: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("commd.bus.session.OPEN_PATIENCE", 60.0 if told else 0.2)
    monkeypatch.setattr("commd.bus.session.STOP_PATIENCE", 0.2)
    # three seconds: none of these waits so long, and no thread within Zenoh is left to the tests after it
    long = """{mode: "router", transport: {link: {protocols: ["unixsock-stream"]}},
      listen: {endpoints: ["tcp/127.0.0.1:0#exit_on_failure=true"], timeout_ms: 3000, exit_on_failure: false}}"""
    stop = asyncio.Event()
    if told:
        stop.set()
    who = {"fleet": "test", "name": "pi", "daemon": "commd", "mode": "router", "stop": stop}
    config = zenoh.Config.from_json5(long)
    with pytest.raises(BusClosed, match=r"Zenoh does not open a session for tcp/127\.0\.0\.1:0"):
        async with open_bus("tcp/127.0.0.1:0", config=config, **who):
            pass


async def test_bad_bytes_are_counted_and_never_reach_the_handler(connect: Connect) -> None:
    sender, receiver, got = await perceived(connect)
    for payload in (b"", b"\xff\xfe", b'{"name":7}', b"[" * 5000):
        sender._session.put(PERCEPT, payload)
    sender._session.put(PERCEPT, b'{"name":"a"}', encoding="application/json;argosy.Perception/2")
    sender.put(PERCEPT, Perception(name="a"))
    await until(lambda: len(got) == 1, "what was sent arrives")
    assert receiver.counters["bad_input"] == 5


async def test_fields_of_a_newer_sender_are_ignored_counted_and_told_once_per_key(
    connect: Connect, caplog: pytest.LogCaptureFixture
) -> None:
    sender, receiver, got = await perceived(connect)
    for _ in range(3):
        sender._session.put(PERCEPT, b'{"name":"a","colour":"red"}')
    await until(lambda: [one.name for _, one in got] == ["a", "a", "a"], "the records arrive all the same")
    assert receiver.counters["unknown_fields"] == 1
    assert receiver.counters["bad_input"] == 0
    assert caplog.text.count("ignored=colour") == 1


async def test_a_query_that_arrives_as_its_session_closes_leaves_no_coroutine_behind(connect: Connect) -> None:
    server, backfill = await connect(), await connect()
    served_by: list[Coroutine[Any, Any, None]] = []

    def serve(query: Query[Action]) -> Coroutine[Any, Any, None]:
        asyncio.get_running_loop().call_soon(server._tasks.cancel)  # before the first step of the task
        served_by.append(never())
        return served_by[0]

    async def never() -> None:
        raise AssertionError("a cancelled task has begun")

    server.serve("argosy/test/uav/action/*", Action, serve)
    await served(backfill, "argosy/test/uav/action/land")
    async for reply in backfill.query("argosy/test/uav/action/land", Action(id="uav:1:1"), ActionStatus, 10):
        raise AssertionError(reply.error)
    assert getcoroutinestate(served_by[0]) == CORO_CLOSED


async def test_what_stands_behind_the_key_of_a_query_reaches_who_serves_it_as_parameters(connect: Connect) -> None:
    server, backfill = await connect(), await connect()
    got: list[tuple[str, dict[str, str]]] = []

    async def serve(query: Query[Action]) -> None:
        got.append((query.key, query.parameters))
        if "wrong" in query.parameters:
            query.reply_error("no such parameter")
        else:
            query.reply(ActionStatus(id="1", name="arm", state="running"))

    key = "argosy/test/uav/action/arm"
    server.serve(key, Action, serve)
    await served(backfill, key)
    got.clear()
    replies = []
    for selector in (key, f"{key}?last=5;about=go", f"{key}?wrong"):
        replies += [(reply.key, reply.error) async for reply in backfill.query(selector, None, ActionStatus, 5.0)]
    assert got == [(key, {}), (key, {"last": "5", "about": "go"}), (key, {"wrong": ""})]
    assert replies == [(key, ""), (key, ""), (key, "no such parameter")]


async def test_ask_one_returns_the_first_record_or_raises_why_there_is_none(connect: Connect) -> None:
    key = "argosy/test/uav/action"

    async def serve(query: Query[Action]) -> None:
        match query.key.rpartition("/")[2]:
            case "arm":
                query.reply(ActionStatus(id="1", state="running"))
                query.reply(ActionStatus(id="2", state="succeeded"))
            case "land":
                query.reply_error("no such action")
            case _:
                await asyncio.Event().wait()

    _, backfill = await serving(connect, serve)
    async with asyncio.timeout(120):
        assert (await backfill.ask_one(f"{key}/arm", Action(), ActionStatus, 10)).id == "1"
        with pytest.raises(QueryFailed, match="no such action") as failed:
            await backfill.ask_one(f"{key}/land", Action(), ActionStatus, 10)
        assert failed.value.key == f"{key}/land"
        with pytest.raises(QueryTimeout, match=r"no answer within 0\.5 s") as late:
            await backfill.ask_one(f"{key}/hover", Action(), ActionStatus, 0.5)
        assert (late.value.timeout, late.value.nobody) == (0.5, False)
        with pytest.raises(QueryTimeout, match="nobody answers") as nobody:
            await backfill.ask_one("argosy/test/usv/action/arm", Action(), ActionStatus, 10)
        assert nobody.value.nobody


async def test_ask_all_hands_over_each_record_as_it_arrives_and_returns_the_errors(connect: Connect) -> None:
    backfill, got, both = await connect("asker"), list[tuple[str, str]](), asyncio.Event()
    for name in ("uav", "usv", "auv"):

        async def serve(query: Query[Action], name: str = name) -> None:
            key = f"argosy/test/{name}/action/arm"
            if name == "auv":
                query.reply_error("under water")
            else:
                query.reply(ActionStatus(id=name, state="running"), key)
                await both.wait()  # a record is handed over before its query has ended

        (await connect(name)).serve(f"argosy/test/{name}/action/arm", Action, serve)
        await served(backfill, f"argosy/test/{name}/action/arm")

    def take(key: str, status: ActionStatus) -> None:
        got.append((key, status.id))
        if len(got) == 2:
            both.set()

    async with asyncio.timeout(120):
        errors = await backfill.ask_all("argosy/test/*/action/arm", ActionStatus, 15, take)
    assert sorted(got) == [(f"argosy/test/{name}/action/arm", name) for name in ("uav", "usv")]
    assert list(errors.values()) == ["under water"]


async def test_a_query_that_zenoh_does_not_end_ends_with_the_router_of_its_replies(endpoint: str) -> None:
    async with AsyncExitStack() as router, AsyncExitStack() as client:
        await router.enter_async_context(open_bus(endpoint, fleet="test", name="board", daemon="commd", mode="router"))
        bus = await client.enter_async_context(open_bus(endpoint, fleet="test", name="uav", daemon="agentd"))
        await until(lambda: bus.router_up, "the router is seen")
        session, bus._session = bus._session, (hung := Mock())
        replies = bus.query("argosy/test/a", None, ActionStatus, 3600)
        asking = asyncio.ensure_future(anext(replies))
        await until(lambda: hung.get.called, "the query is sent")
        bus._session = session
        assert not asking.done(), "neither the first sight of the router nor anything else has ended it"
        await router.aclose()
        assert (await asyncio.wait_for(asking, 120)).error == ROUTER_LOST
        assert await anext(replies, None) is None
        token = hung.get.call_args.kwargs["cancellation_token"]
        await until(lambda: token.is_cancelled, "Zenoh does not keep it until its timeout")


async def test_of_a_query_that_cannot_be_sent_nothing_is_heard(connect: Connect) -> None:
    bus, heard = await connect("uav"), list[object]()
    bus._session.close()
    with pytest.raises(BusClosed):
        bus.ask("argosy/test/a", None, ActionStatus, 10, heard.append)
    put = asyncio.Event()
    bus._dispatch.put(lambda _: put.set(), None)  # what Zenoh has handed over is before it
    await put.wait()
    assert heard == []


async def test_an_abandoned_query_is_cancelled(connect: Connect) -> None:
    async def forever(query: Query[Action]) -> None:
        query.reply(ActionStatus(id="1", state="running"))
        await asyncio.sleep(60)

    _, backfill = await serving(connect, forever)
    async with aclosing(backfill.query(ACTION, Action(), ActionStatus, 60)) as replies:
        async for reply in replies:
            assert reply.record is not None
            break
    assert await backfill.tokens("argosy/**") == []  # the session still answers


@pytest.mark.parametrize(
    ("payload", "code"), [(b'{"parameters": 5}', "bad_record"), (b'{"parameters": ' + b"[" * 100_000, "too_deep")]
)
async def test_an_asker_knows_by_a_code_what_is_wrong_with_its_payload(
    connect: Connect, monkeypatch: pytest.MonkeyPatch, payload: bytes, code: str
) -> None:
    async def serve(query: Query[Action]) -> None:
        query.reply_error(query.error)

    _, backfill = await serving(connect, serve)
    monkeypatch.setattr(codec(Action), "encode", lambda *_: payload)
    with pytest.raises(QueryFailed) as failed:
        await backfill.ask_one(ACTION, Action(), ActionStatus, 10)
    assert failed.value.code == code


@virtual_bus_test
async def test_a_second_live_instance_of_a_name_is_refused_and_named(connect: Connect) -> None:
    first, second = await connect("uav"), await connect("uav")
    await first.claim("uav")
    with pytest.raises(AlreadyRunning, match=f"another agentd serves `uav`.*boot {first.boot}"):
        await second.claim("uav")


async def test_of_two_that_claim_a_name_in_the_same_moment_one_has_it_whoever_looks_first(
    connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commd.bus.bus.CLAIM_PATIENCE", 1.0)
    early, late = sorted([await connect("uav"), await connect("uav")], key=lambda bus: bus.boot, reverse=True)
    looks = late._claimed

    async def claimed_after_the_look(names: Sequence[str]) -> dict[str, list[str]]:
        found = await looks(names)
        if not early._held:
            await early.claim("uav")
        return found

    monkeypatch.setattr(late, "_claimed", claimed_after_the_look)
    with pytest.raises(AlreadyRunning, match=f"boot {early.boot}"):
        await late.claim("uav")
    assert (len(early._held), len(late._held)) == (1, 0)


async def test_of_many_that_claim_a_name_in_the_same_moment_exactly_one_has_it(connect: Connect) -> None:
    sessions, names = [await connect("uav") for _ in range(4)], [f"uav{number}" for number in range(10)]

    async def claimed(name: str) -> None:
        claims = await asyncio.gather(*(one.claim(name) for one in sessions), return_exceptions=True)
        assert [type(one) for one in claims].count(AlreadyRunning) == 3

    await asyncio.gather(*map(claimed, names))
    assert sorted(key.split("/")[2] for one in sessions for key in one._held.values()) == names


@pytest.mark.parametrize(("starts_within", "logged"), [(60, 0), (0, 1)])
async def test_a_router_that_is_not_reached_is_logged_when_it_has_had_time_to_start(
    endpoint: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, starts_within: float, logged: int
) -> None:
    monkeypatch.setattr("commd.bus.session.STARTS_WITHIN", starts_within)
    with pytest.raises(BusClosed, match=r"no router at .*: is commd running"):
        async with open_bus(endpoint, fleet="test", name="uav", daemon="agentd", patience=0.3):
            pass
    assert caplog.text.count("waiting for the router") == logged


async def test_a_flood_is_bounded_and_its_excess_is_counted(connect: Connect, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("commd.bus.loop_dispatch.BACKLOG", 100)
    sender, receiver, got = await perceived(connect)
    for _ in range(500):
        sender.put(PERCEPT, Perception(name="a"))
    # the event loop is held up on purpose until Zenoh's threads have delivered everything
    poll(lambda: receiver.counters["dropped"] >= 400, "what does not fit is dropped")
    await until(lambda: len(got) + receiver.counters["dropped"] == 500, "what was sent arrives")
    assert len(got) == 100


async def test_a_session_ending_in_a_flood_blames_nobody(connect: Connect, caplog: pytest.LogCaptureFixture) -> None:
    bus = await connect()
    for _ in range(1000):
        bus._dispatch.put(time.sleep, 0.005)
    await bus.close()
    assert not [one for one in caplog.records if "hangs" in one.message]


async def test_what_is_urgent_is_served_while_others_wait(connect: Connect, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("commd.bus.queries.QUERIES", 3)
    backfill, server = await connect(), await connect()
    waiting, done = list[Query[Action]](), asyncio.Event()

    async def slow(query: Query[Action]) -> None:
        waiting.append(query)
        await done.wait()

    async def quick(query: Query[Action]) -> None:
        query.reply(ActionStatus(id="x", state="cancelled"))

    async def ask(key: str) -> list[Any]:
        return [reply async for reply in backfill.query(key, Action(), ActionStatus, 10)]

    server.serve("argosy/test/uav/action/goto", Action, slow)
    server.serve("argosy/test/uav/cancel", Action, quick, urgent=True)
    await served(backfill, "argosy/test/uav/action/goto")
    await served(backfill, "argosy/test/uav/cancel")
    asking = [asyncio.create_task(ask("argosy/test/uav/action/goto")) for _ in range(3)]
    await until(lambda: len(waiting) == 3, "all places are taken")
    assert [reply.error for reply in await ask("argosy/test/uav/action/goto")] == ["busy: too many queries at once"]
    assert [reply.record.id for reply in await ask("argosy/test/uav/cancel")] == ["x"]
    done.set()
    await asyncio.gather(*asking)


async def test_a_payload_that_is_larger_than_its_server_wants_is_refused_unread(connect: Connect) -> None:
    async def never(query: Query[Action]) -> None:
        raise AssertionError(query.key)

    server, backfill = await serving(connect, never, at_most=100)
    large = Action(parameters=("x" * 100,))
    replies = [one async for one in backfill.query(ACTION, large, ActionStatus, 10)]
    assert [one.error for one in replies] == ["Action: 119 bytes, expected at most 100"]
    assert server.counters["bad_input"] == 1


async def test_the_admin_space_of_the_router_can_be_read(connect: Connect) -> None:
    client = await connect("uav")
    answers = await asyncio.to_thread(
        lambda: [str(r.ok.key_expr) for r in client._session.get("@/*/router", timeout=10)]
    )
    assert len(answers) == 1


@virtual_bus_test
async def test_who_takes_longer_with_a_reply_than_the_question_lasts_is_not_cancelled(connect: Connect) -> None:
    async def fly(query: Query[Action]) -> None:
        query.reply(ActionStatus(id="1", state="running"))
        query.reply(ActionStatus(id="1", state="succeeded"))

    _, backfill = await serving(connect, fly)
    states = list[str]()
    async with aclosing(backfill.query(ACTION, None, ActionStatus, 0.2)) as replies:
        async for reply in replies:
            states.append(reply.record.state)
            await asyncio.sleep(1.3)
    assert states == ["running", "succeeded"]


@virtual_bus_test
async def test_a_router_without_rules_that_shows_a_token_too_late_is_not_said_to_deny_it(
    connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def nobody(bus: Bus, names: Sequence[str]) -> dict[str, list[str]]:
        return {}

    bus = await connect("uav")
    monkeypatch.setattr(Bus, "_claimed", nobody)
    monkeypatch.setattr("commd.bus.bus.CLAIM_PATIENCE", 0.1)
    with pytest.raises(BusClosed, match=r"does not show the token of `uav` within 0\.1 s") as caught:
        await bus.claim("uav")
    assert not isinstance(caught.value, AccessDenied)


async def test_a_session_is_told_of_who_listened_before_and_of_nobody_where_there_is_none(connect: Connect) -> None:
    speaker, other = await connect(), await connect()
    before, nobody = list[bool](), list[bool]()
    other.raw.subscribe("argosy/test/uav/trace/inputs", lambda sample: None)
    await subscribed(speaker, "argosy/test/uav/trace/inputs")
    speaker.listened("argosy/test/uav/trace/inputs", before.append)
    speaker.listened("argosy/test/uav/trace/activity", nobody.append)
    await speaker.round_trip(5.0)
    await other.round_trip(5.0)
    assert (before, nobody) == ([True], [])


class HeldQuery:
    """A query of Zenoh whose route is full: a reply waits, and nobody else may touch the query meanwhile."""

    key_expr = "argosy/test/uav/mind"

    def __init__(self) -> None:
        self.replying, self.room, self.dropped = threading.Event(), threading.Event(), 0

    def __enter__(self) -> None: ...

    def __exit__(self, *_: object) -> None:
        self.drop()

    def reply(self, *_: object, **__: object) -> None:
        self.replying.set()
        self.room.wait(10.0)
        self.replying.clear()

    def drop(self) -> None:
        if self.replying.is_set():
            raise RuntimeError("Already borrowed")
        self.dropped += 1


@pytest.mark.parametrize("ended", [True, False], ids=["the bus is closed", "the route has room again"])
async def test_a_query_that_a_thread_replies_to_is_not_touched_meanwhile(connect: Connect, ended: bool) -> None:
    bus, held = await connect(), HeldQuery()
    failures: list[dict[str, Any]] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: failures.append(context))
    ours = Query[Any](bus, cast("zenoh.Query", held), None)
    serving = bus._observer_tasks.spawn(
        bus._serve(cast("zenoh.Query", held), ours, ours.answer(Perception(name="altitude")))
    )
    await asyncio.to_thread(held.replying.wait, 10.0)
    if ended:
        serving.cancel()
        await asyncio.wait([serving])
    held.room.set()
    await asyncio.wait([serving])
    assert (failures, held.dropped) == ([], 0 if ended else 1)
