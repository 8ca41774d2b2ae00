"""The Zenoh driver: percepts from what a robot publishes, actions by what it listens to and serves; real router."""

import asyncio
import json
import math
from collections import Counter
from contextlib import AbstractAsyncContextManager, AsyncExitStack
from types import SimpleNamespace
from typing import Literal, cast

import msgspec
import pytest
import zenoh

from bridged.drivers.api import Outcome
from commd.bus.bus import Bus, open_bus
from commd.bus.loop_dispatch import LoopDispatch
from commd.bus.raw import BACKLOG, LARGEST, REPLIES, Sample, Subscription
from schemas.manifest.loader import read_manifest
from tests.bridged.pond import MANIFEST, Pond, in_a_pond, manifest, served, until
from tests.bridged.sky import end_of
from tests.support.notes import identities
from tests.support.processes import poll


@pytest.fixture
def pond(endpoint: str) -> AbstractAsyncContextManager[Pond]:
    return in_a_pond(endpoint)


@pytest.fixture(autouse=True)
def _short_discovery(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever is there is seen at once; whoever is not is not waited for long."""
    monkeypatch.setattr("bridged.drivers.zenoh.driver.DISCOVERY", 0.4)


def fields(pond: Pond) -> list[object]:
    return [reading.fields for reading in pond.readings]


@pytest.mark.parametrize(
    ("payload", "encoding", "said"),
    [
        (b'{"on": true, "watts": 4.5}', "application/json", {"on": True, "watts": 4.5}),
        (b'{"on": true}', "", {"on": True}),
        (b"21.5", "text/plain", {"data": 21.5}),
        (b'"bright"', "text/json", {"data": "bright"}),
        (b"[1, 2]", "application/json;lamp", {"data": [1, 2]}),
        (b"", "", {}),
        (msgspec.msgpack.encode({"on": [1.5, "x"]}), "application/msgpack", {"on": [1.5, "x"]}),
    ],
)
async def test_a_sample_gives_its_payloads_fields(pond: Pond, payload: bytes, encoding: str, said: object) -> None:
    await pond.publish("lamp/state", payload, encoding=encoding)
    await until(lambda: bool(pond.readings), "the sample is read")
    assert fields(pond) == [said]
    assert pond.readings[0].source == "lamp/state"


async def test_a_manifest_says_what_samples_without_an_encoding_are(endpoint: str) -> None:
    async with in_a_pond(
        endpoint, text=MANIFEST.replace('driver = "zenoh"', 'driver = "zenoh"\npayload = "msgpack"')
    ) as pond:
        await pond.publish("lamp/state", msgspec.msgpack.encode({"on": 1}))
        await until(lambda: bool(pond.readings), "the sample is read")
        assert fields(pond) == [{"on": 1}]
        heard = await pond.hear("lamp/text")
        assert (await pond.do("tell", text="hello")).state == "succeeded"
        await until(lambda: bool(heard), "the text is heard")
        assert (heard[0].encoding, msgspec.msgpack.decode(heard[0].payload)) == (
            "application/msgpack",
            {"text": "hello"},
        )


async def test_a_deleted_key_says_that_its_percepts_hold_no_longer(pond: Pond) -> None:
    await pond.publish("lamp/state", b'{"on": true}')
    await until(lambda: bool(pond.readings), "the sample is read")
    pond.robot._session.delete("lamp/state")
    await until(lambda: len(pond.readings) == 2, "the deletion is read")
    assert fields(pond)[-1] is None


async def test_bad_payloads_are_counted_and_told_and_the_next_good_one_is_read(pond: Pond) -> None:
    bad = [b"{", b"\xff\xfe", b"[" * 60_000, b'{"on": NaN}']
    await pond.publish("lamp/state", *bad, b'{"on": true}')
    await until(lambda: bool(pond.readings), "the good sample is read")
    await pond.publish("lamp/state", b"\x00", encoding="application/cdr")
    await until(lambda: pond.driver.counters()["samples_unreadable"] == 5, "the bad ones are counted")
    assert fields(pond) == [{"on": True}]
    (note,) = pond.driver.notes()
    assert (note.identity, note.value) == (("samples_unreadable", "lamp/state"), 5)
    assert len(note.text) < 400


async def test_a_payload_that_is_too_large_is_not_taken_in(pond: Pond) -> None:
    await pond.publish("lamp/state", b'"' + b"x" * LARGEST + b'"', b"1")
    await until(lambda: bool(pond.readings), "the small sample is read")
    assert fields(pond) == [{"data": 1}]
    assert [(note.identity, note.value) for note in pond.driver.notes()] == [(("samples_too_large", "lamp/state"), 1)]


async def test_silence_from_the_start_is_told(endpoint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bridged.drivers.zenoh.driver.PATIENCE", 0.05)
    async with in_a_pond(endpoint) as pond:
        await until(lambda: bool(pond.driver.notes()), "the silence is told")
        assert identities(pond.driver.notes()) == [("source_never_heard", "lamp/state")]
        assert not pond.driver.heard
        assert pond.driver.silence == math.inf
        await pond.publish("lamp/state", b"1")
        await until(lambda: pond.driver.heard, "the robot is heard")
        assert pond.driver.notes() == []
        assert pond.driver.silence < 5


async def test_a_put_reaches_who_listens_nested_as_the_paths_say(pond: Pond) -> None:
    heard = await pond.hear("lamp/set")
    assert (await pond.do("set_light", on=True, colour="red")).state == "succeeded"
    await until(lambda: bool(heard), "the lamp hears it")
    assert json.loads(heard[0].payload) == {"state": {"on": True, "rgb": [7, 8]}, "colour": "red"}
    assert heard[0].encoding == "application/json"


async def test_nobody_listens_until_a_listener_appears(pond: Pond, monkeypatch: pytest.MonkeyPatch) -> None:
    outcome = await pond.do("set_light", on=True, colour="red")
    assert (outcome.state, outcome.reason) == ("failed", "nobody subscribes to lamp/set")
    monkeypatch.setattr("bridged.drivers.zenoh.driver.DISCOVERY", 10)
    waiting = pond.begin("set_light", on=True, colour="red")
    assert waiting.outcome is None
    heard = await pond.hear("lamp/set")
    await until(lambda: waiting.over, "the action ends")
    assert waiting.outcome.state == "succeeded", waiting.outcome.reason
    await until(lambda: len(heard) == 1, "the lamp hears it")


async def test_a_robot_that_listens_where_it_publishes_does_not_count_the_bridge_as_either(endpoint: str) -> None:
    text = MANIFEST.replace('source = "lamp/state"', 'source = "lamp/set"')
    async with in_a_pond(endpoint, text=text) as pond:
        outcome = await pond.do("set_light", on=True, colour="red")
        assert outcome.reason == "nobody subscribes to lamp/set"
        heard = await pond.hear("lamp/set")
        assert (await pond.do("set_light", on=True, colour="red")).state == "succeeded"
        await until(lambda: bool(heard), "the lamp hears it")
        await pond.publish("lamp/set", b'{"on": false}')
        await until(lambda: bool(pond.readings), "what the lamp publishes is read")
        assert fields(pond) == [{"on": False}]


async def test_a_late_listener_asks_for_the_last_value_of_a_latched_topic(pond: Pond) -> None:
    subscription = pond.robot.raw.subscribe("lamp/text", lambda _: None)
    await served(pond.robot, "lamp/text")
    late = pond.robot.raw.querier("lamp/text")
    assert [reply async for reply in late.ask(b"", "")] == []
    for text in ("one", "two"):
        assert (await pond.do("tell", text=text)).state == "succeeded"
    replies = [json.loads(reply.payload) async for reply in late.ask(b"", "")]
    assert replies == [{"text": "two"}]
    subscription.close()


@pytest.mark.parametrize(
    ("reply", "error", "state", "reason"),
    [
        (b'{"success": true}', False, "succeeded", ""),
        (b'{"result": 0}', False, "succeeded", ""),
        (b"", False, "succeeded", ""),
        (b"[1]", False, "succeeded", ""),
        (b'{"success": true, "result": 4}', False, "succeeded", ""),
        (b'{"success": false, "message": "too bright"}', False, "failed", "lamp/blink: too bright"),
        (b'{"ok": false, "reason": "broken"}', False, "failed", "lamp/blink: broken"),
        (b'{"result": 4}', False, "failed", 'lamp/blink: {"result": 4}'),
        (b"no such lamp", True, "failed", "lamp/blink: no such lamp"),
        (b"", True, "failed", "lamp/blink: an error without words"),
        (None, False, "failed", "lamp/blink ended without a reply"),
    ],
)
async def test_services_say_how_it_went(pond: Pond, reply: bytes | None, error: bool, state: str, reason: str) -> None:
    asked = await pond.serve("lamp/blink", reply, error=error)
    assert end_of(await pond.do("blink", times=3)) == (state, reason)
    assert [json.loads(payload) for payload in asked] == [{"times": 3}]


async def test_a_reply_that_cannot_be_read_is_no_success(pond: Pond) -> None:
    await pond.serve("lamp/blink", b"{")
    outcome = await pond.do("blink", times=3)
    assert outcome.state == "failed"
    assert outcome.reason.startswith("lamp/blink: its reply cannot be read: ")


async def test_of_several_replies_one_refusal_decides(pond: Pond) -> None:
    await pond.serve("lamp/blink", b'{"success": true}')
    await pond.serve("lamp/blink", b'{"success": false, "message": "the second lamp is broken"}')
    outcome = await pond.do("blink", times=3)
    assert outcome.reason == "lamp/blink: the second lamp is broken"


async def test_a_service_that_replies_and_does_not_end_has_replied(pond: Pond) -> None:
    held: list[zenoh.Query] = []

    def hold(query: zenoh.Query) -> None:
        query.reply("lamp/blink", b'{"success": true}')
        held.append(query)

    pond.robot._session.declare_queryable("lamp/blink", zenoh.handlers.Callback(hold, indirect=False))
    assert (await pond.do("blink", times=3)).state == "succeeded"
    held[0].drop()


async def test_a_query_ends_when_its_action_is_stopped(pond: Pond) -> None:
    held = await pond.hold("lamp/blink")
    execution = pond.begin("blink", times=3)
    await until(lambda: bool(held), "the query arrives")
    assert execution.waits_for == "the reply of lamp/blink"
    pond.driver.stop(execution, Outcome("timed_out", "not done"), hold=False)
    assert execution.outcome == Outcome("timed_out", "not done")
    with held[0]:
        held[0].reply("lamp/blink", b'{"success": true}')
    again = pond.begin("blink", times=4)
    await until(lambda: len(held) == 2, "the next query arrives")
    with held[1]:
        held[1].reply("lamp/blink", b'{"success": true}')
    await until(lambda: again.over, "the next action ends")
    assert again.outcome == Outcome("succeeded")
    assert execution.outcome == Outcome("timed_out", "not done")


async def test_a_service_that_dies_fails_the_action(pond: Pond) -> None:
    held = await pond.hold("lamp/blink")
    execution = pond.begin("blink", times=3)
    await until(lambda: bool(held), "the query arrives")
    await asyncio.to_thread(pond.robot._session.close)
    await until(lambda: execution.over, "the action ends")
    assert execution.outcome.state == "failed"


async def test_keys_stand_under_the_robots_prefix(endpoint: str) -> None:
    async with in_a_pond(endpoint, prefix="hall/two") as pond:
        heard = await pond.hear("hall/two/lamp/set")
        asked = await pond.serve("hall/two/lamp/blink", b"")
        assert (await pond.do("set_light", on=True, colour="red")).state == "succeeded"
        assert (await pond.do("blink", times=1)).state == "succeeded"
        assert (await pond.do("tell", text="x")).reason == "nobody subscribes to hall/two/lamp/text"
        await until(lambda: bool(heard) and bool(asked), "the lamp of the hall hears it")
        await pond.publish("hall/two/lamp/state", b'{"on": true}')
        await until(lambda: bool(pond.readings), "the lamp of the hall is heard")
        assert pond.readings[0].source == "lamp/state"


async def test_a_bridge_that_is_too_slow_keeps_the_newest_and_counts_the_rest(pond: Pond) -> None:
    await pond.publish("lamp/state", b"-1")
    await until(lambda: bool(pond.readings), "the first is read")
    publisher = pond.robot.raw.publisher("lamp/state")
    await until(lambda: publisher.matching, "the bridge listens")
    for number in range(2 * BACKLOG):
        publisher.put(b"%d" % number, "application/json")
    subscription = pond.driver._sources.by_name["lamp/state"].subscription
    assert subscription is not None
    # the event loop stands still, Zenoh's threads do not
    poll(lambda: subscription.dropped >= BACKLOG, "what does not fit is dropped")
    await until(lambda: len(pond.readings) == 1 + BACKLOG, "what was kept is read")
    assert fields(pond)[1:] == [{"data": number} for number in range(BACKLOG, 2 * BACKLOG)]
    assert pond.driver.counters()["samples_dropped"] == BACKLOG
    assert pond.driver._bus.counters["dropped"] == BACKLOG


async def test_what_waits_for_a_slow_bridge_is_bounded_in_bytes_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("commd.bus.raw.ROOM", 100)
    monkeypatch.setattr("commd.bus.raw._read_sample", lambda sample: sample)
    told: list[Sample] = []
    session = cast("zenoh.Session", SimpleNamespace(declare_subscriber=lambda *_, **__: None))
    dispatch = LoopDispatch(asyncio.get_running_loop(), Counter())
    queue = Subscription(session, "k/*", dispatch, told.append, lambda *_: lambda: None)
    samples = [Sample(f"k/{number}", bytes(40), "") for number in range(6)]
    for some, dropped in ((samples[:3], 1), (samples[3:5], 1), (samples[5:], 1)):
        for sample in some:
            queue._push(cast("zenoh.Sample", sample))
        await until(lambda: not queue._calls, "what is kept is handled")
        assert queue.dropped == dropped
    assert told == samples[1:]


async def test_another_manifest_takes_effect_without_a_pause(endpoint: str) -> None:
    changed = MANIFEST.replace('topic = "lamp/text"', 'topic = "lamp/words"') + (
        '[percepts.heat]\nsource = "lamp/heat"\nargs = ["data"]\n'
    )
    async with in_a_pond(endpoint) as pond:
        before = pond.driver._sources.by_name["lamp/state"].subscription
        pond.manifest = read_manifest(changed, "lamp.toml")
        pond.driver.adopt(pond.manifest)
        assert pond.driver._sources.by_name["lamp/state"].subscription is before
        await pond.publish("lamp/heat", b"40")
        await until(lambda: bool(pond.readings), "the heat is read")
        assert (await pond.do("tell", text="x")).reason == "nobody subscribes to lamp/words"
        pond.driver.adopt(read_manifest(MANIFEST, "lamp.toml"))
        assert list(pond.driver._sources.by_name) == ["lamp/state"]


async def test_what_runs_goes_on_when_another_manifest_has_it_no_longer(pond: Pond) -> None:
    held = await pond.hold("lamp/blink")
    execution = pond.begin("blink", times=3)
    await until(lambda: bool(held), "the query arrives")
    pond.driver.adopt(read_manifest(MANIFEST.partition("[actions.blink]")[0], "lamp.toml"))
    with held.pop() as query:
        query.reply("lamp/blink", b'{"success": true}')
    del query
    await until(lambda: execution.over, "the action ends")
    assert execution.outcome == Outcome("succeeded")


async def test_an_action_that_is_taken_away_while_it_waits_for_a_listener_ends_in_words(pond: Pond) -> None:
    told, asked = pond.begin("tell", text="x"), pond.begin("blink", times=1)
    await asyncio.sleep(0)
    pond.driver.adopt(read_manifest(MANIFEST.partition("[actions.tell]")[0], "lamp.toml"))
    await until(lambda: told.over and asked.over, "both end")
    assert told.outcome == Outcome("failed", "nobody subscribes to lamp/text")
    assert asked.outcome == Outcome("failed", "nobody serves lamp/blink")


async def test_a_defect_where_a_reply_is_read_fails_its_action_and_no_other(endpoint: str) -> None:
    def defect(*_: object) -> None:
        raise KeyError("depth")

    async with in_a_pond(endpoint) as pond:
        told: list[str] = []
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(lambda _, context: told.append(context["message"]))
        await pond.serve("lamp/blink", b'{"success": true}')
        pond.driver._sources.answered = defect  # type: ignore[method-assign]
        outcome = await pond.do("blink", times=1)
        assert outcome == Outcome("failed", "defect in the driver: KeyError: 'depth'")
        assert told == ["carrying out blink"]
        del pond.driver._sources.answered
        assert (await pond.do("blink", times=1)).state == "succeeded", "the driver runs on"


async def test_a_robot_that_says_something_only_in_replies_is_heard_by_them(endpoint: str) -> None:
    percept = MANIFEST.partition("[actions")[0].replace("lamp/state", "lamp/blink").replace('"on"', '"count"')
    async with in_a_pond(endpoint, text=percept + "[actions" + MANIFEST.partition("[actions")[2]) as pond:
        await pond.serve("lamp/blink", b'{"success": true, "count": 3}')
        assert not pond.driver.heard
        assert (await pond.do("blink", times=1)).state == "succeeded"
        assert fields(pond)[0]["count"] == 3
        assert pond.driver.heard
        assert pond.driver.counters()["samples"] == 1


async def test_replies_that_are_too_many_to_wait_are_counted(pond: Pond) -> None:
    held = await pond.hold("lamp/blink")
    execution = pond.begin("blink", times=3)
    await until(lambda: bool(held), "the query arrives")
    with held.pop() as query:
        for _ in range(REPLIES + 5):
            query.reply("lamp/blink", b"")
    del query
    # the event loop stands still, Zenoh's threads do not
    poll(lambda: len(pond.driver._bus._dispatch._waiting) >= REPLIES + 5, "all replies are there")
    await until(lambda: execution.over, "the action ends")
    assert pond.driver._bus.counters["dropped"] == 5


async def test_a_router_that_is_away_is_named(endpoint: str) -> None:
    async with AsyncExitStack() as stack:
        router = await stack.enter_async_context(_bus(endpoint, "router"))
        lamp = await stack.enter_async_context(_bus(endpoint))
        robot = await stack.enter_async_context(_bus(endpoint))
        pond = Pond(lamp, robot, manifest())
        robot.raw.subscribe("lamp/set", lambda _: None)
        assert (await pond.do("set_light", on=True, colour="red")).state == "succeeded"
        await router.close()
        await until(lambda: not lamp.router_up, "the router is missed")
        outcome = await pond.do("set_light", on=True, colour="red")
        assert outcome.reason == "nobody subscribes to lamp/set: the router is away"
        async with _bus(endpoint, "router"):
            await until(lambda: lamp.router_up and robot.router_up, "the router is back")
            await until(lambda: pond.driver._topics["lamp/set", False].heard, "the lamp is seen again")
            assert (await pond.do("set_light", on=True, colour="red")).state == "succeeded"


def _bus(endpoint: str, mode: Literal["client", "router"] = "client") -> AbstractAsyncContextManager[Bus]:
    return open_bus(endpoint, fleet="test", name=mode, daemon="lamp", mode=mode)
