"""An action from the agent's side, over a real bus: one final status, whatever happens to the bridge."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from types import SimpleNamespace
from typing import Any, cast

import pytest
import zenoh

from commd.bus.bus import Bus, Query
from commd.client.actions import ActionRequests
from commd.client.percept_sync import PerceptSync
from commd.common.clock import Clock
from commd.liveness.bridge_presence import BridgePresence
from commd.process.process import report_health
from schemas.liveness import ACTION_ASKED_AGAIN
from schemas.wire import keys
from schemas.wire.records import Action, ActionStatus, Cancel, Header, Health, Perception, Perceptions, State
from schemas.wire.terms import Term
from tests.support.buses import FLEET, Connect, bus_test, served, subscribed, until
from tests.support.promises import in_time

Served = Callable[[Query[Action]], Awaitable[None]]


def answer(query: Query[Action] | Query[Cancel], state: State, **more: Any) -> None:
    """Reply a status of the action that is asked for."""
    assert query.record is not None
    query.reply(ActionStatus(id=query.record.id, state=state, **more))


def request(name: str, parameters: tuple[Term, ...] = (), identity: str = "uav:b:1") -> Action:
    """Return what an agent asks for."""
    return Action(id=identity, agent="uav", name=name, parameters=parameters)


def altitude(header: Header, metres: float) -> Perceptions:
    """Return what a bridge puts of an altitude."""
    return Perceptions(changes=(Perception(header=header, name="altitude", parameters=(metres,)),))


async def act(connect: Connect, serve: Served | None) -> tuple[ActionRequests, PerceptSync, Bus, BridgePresence]:
    """Return an agent's side of actions, with a bridge that serves them by `serve`."""
    bridge = await connect("uav1", "bridged")
    if serve is not None:
        bridge.serve(keys.action(FLEET, "uav", "*"), Action, serve)
    await bridge.claim("uav1")
    bus = await connect("uav")
    if serve is not None:
        await served(bus, keys.action(FLEET, "uav", "*"))
    perceiving = PerceptSync(bus, "uav", "uav1", lambda one: None)
    watch = BridgePresence(bus, "uav1", lambda: None, lambda: None)
    await until(lambda: watch.up, "the bridge is seen")
    return ActionRequests(bus, "uav", perceiving, watch), perceiving, bridge, watch


@bus_test
async def test_an_action_ends_with_the_bridges_own_final_status(connect: Connect) -> None:
    async def serve(query: Query[Action]) -> None:
        answer(query, "accepted")
        answer(query, "refused", result=False, reason="Arm: RTL mode not armable")

    action_requests, *_ = await act(connect, serve)
    status = await action_requests.perform(request("arm_motors", (True,)), 10)
    assert (status.state, status.reason) == ("refused", "Arm: RTL mode not armable")
    assert action_requests.counters["asked_again"] == 0


@bus_test
async def test_an_answer_that_breaks_off_is_asked_for_again_with_the_same_id(connect: Connect) -> None:
    asked: list[tuple[str, int]] = []

    async def serve(query: Query[Action]) -> None:
        assert query.record is not None
        asked.append((query.record.id, query.record.attempt))
        if len(asked) < 3:
            answer(query, "running")
        else:
            answer(query, "succeeded", result=True)

    action_requests, *_ = await act(connect, serve)
    status = await action_requests.perform(request("land"), 30)
    assert status.state == "succeeded"
    assert asked == [("uav:b:1", 1), ("uav:b:1", 2), ("uav:b:1", 3)]


@bus_test
async def test_an_action_of_which_nothing_is_heard_for_three_periods_is_asked_for_again(connect: Connect) -> None:
    asked: list[int] = []

    async def serve(query: Query[Action]) -> None:
        assert query.record is not None
        asked.append(query.record.attempt)
        if len(asked) == 1:
            answer(query, "accepted", deadline=600.0)
            await asyncio.sleep(60)  # as a query that is broken and that nobody ends
        answer(query, "succeeded", result=True)

    action_requests, *_ = await act(connect, serve)
    status = await asyncio.wait_for(action_requests.perform(request("land"), 30), 5 * ACTION_ASKED_AGAIN)
    assert status.state == "succeeded"
    assert asked == [1, 2]


@bus_test
async def test_a_bridge_that_is_slow_to_take_an_action_has_its_time_and_is_asked_by_the_same_attempt(
    connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commd.client.actions.ACTION_ASKED_AGAIN", 0.2)
    monkeypatch.setattr("commd.client.actions.BUS_GRACE", 0.5)
    asked: list[int] = []

    async def serve(query: Query[Action]) -> None:
        assert query.record is not None
        asked.append(query.record.attempt)
        await asyncio.sleep(60 if len(asked) < 6 else 0)
        answer(query, "succeeded", result=True)

    action_requests, *_ = await act(connect, serve)
    status = await action_requests.perform(request("land"), 30)
    assert status.state == "succeeded"
    assert asked == [1] * 6


@bus_test
async def test_an_action_that_nobody_serves_fails_after_the_grace(
    connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commd.client.actions.BUS_GRACE", 0.5)
    action_requests, *_ = await act(connect, None)
    status = await action_requests.perform(request("land"), 30)
    assert (status.state, status.result) == ("failed", False)
    assert status.reason == "bridge_lost: nobody serves this action"


@bus_test
async def test_an_action_whose_statuses_stopped_before_the_loss_of_the_router_was_noticed_has_the_grace_from_then(
    connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commd.client.actions.BUS_GRACE", 0.5)
    asked = list[int]()

    async def serve(query: Query[Action]) -> None:
        assert query.record is not None
        asked.append(query.record.attempt)
        answer(query, "succeeded" if len(asked) > 1 else "running")
        await asyncio.sleep(600)

    action_requests, *_ = await act(connect, serve)
    flying = asyncio.create_task(action_requests.perform(request("goto"), 60))
    await until(lambda: asked, "it runs")
    await asyncio.sleep(1)
    bus = action_requests._bus
    for zid in bus._routers.copy():
        for kind in (zenoh.SampleKind.DELETE, zenoh.SampleKind.PUT):
            bus._router_event(
                cast(zenoh.TransportEvent, SimpleNamespace(kind=kind, transport=SimpleNamespace(zid=zid)))
            )
    status = await asyncio.wait_for(flying, 120)
    assert (status.state, asked) == ("succeeded", [1, 2])


@bus_test
async def test_a_dead_bridge_fails_the_action_and_says_so(connect: Connect) -> None:
    async def serve(query: Query[Action]) -> None:
        answer(query, "running")
        begun.set()
        await asyncio.sleep(60)

    begun = asyncio.Event()
    action_requests, _, bridge, _ = await act(connect, serve)
    flying = asyncio.create_task(action_requests.perform(request("goto", (1, 2, 3)), 60))
    await asyncio.wait_for(begun.wait(), 120)
    await bridge.close()
    status = await asyncio.wait_for(flying, 120)
    assert status.state == "failed"
    assert status.reason == "bridge_lost: the bridge of this robot is not running"


@bus_test
async def test_a_status_waits_for_the_percept_that_it_follows(
    connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commd.client.actions.AFTER_PATIENCE", 10.0)

    async def serve(query: Query[Action]) -> None:
        header = bridge.header("percept")
        answer(query, "succeeded", header=header, result=True, after=header.seq)
        await asyncio.sleep(0.1)  # the percept comes after the status that follows it
        bridge.put(keys.percepts(FLEET, "uav"), altitude(header, 5))

    action_requests, perceiving, bridge, _ = await act(connect, None)
    bridge.serve(keys.action(FLEET, "uav", "*"), Action, serve)
    await subscribed(bridge, keys.percepts(FLEET, "uav"))
    bridge.put(keys.percepts(FLEET, "uav"), altitude(bridge.header("percept"), 0))
    await until(lambda: perceiving.percepts.seq == 1, "the first percept arrives")
    status = await action_requests.perform(request("takeoff", (5,)), 10)
    assert status.state == "succeeded"
    assert perceiving.percepts.present()[0].parameters == (5,)
    assert perceiving.counters["late"] == 0


@bus_test
async def test_a_status_waits_until_a_percept_that_was_lost_before_it_is_repaired(
    connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commd.client.actions.AFTER_PATIENCE", 30.0)
    action_requests, perceiving, bridge, _ = await act(connect, None)
    present = [Perception(header=bridge.header("percept"), name="altitude", parameters=(0,))]

    async def repair(query: Query[Perception]) -> None:
        query.reply(present[0], keys.percept(FLEET, "uav", "altitude"))

    async def serve(query: Query[Action]) -> None:
        header = bridge.header("percept")
        present[:] = [Perception(header=header, name="altitude", parameters=(5,))]  # its put is lost
        after = header.seq
        answer(query, "succeeded", header=header, result=True, after=after)
        asyncio.get_running_loop().call_later(1.0, perceiving.doubt)  # as by the next health

    bridge.serve(keys.percept(FLEET, "uav", "**"), Perception, repair)
    bridge.serve(keys.action(FLEET, "uav", "*"), Action, serve)
    repairing = asyncio.create_task(perceiving.run())
    # The first query may be earlier than the bridge's declaration is known here: health has it repeated.
    await until(lambda: perceiving.percepts.seq == 1 or perceiving.doubt(), "the first percept arrives")
    status = await action_requests.perform(request("takeoff", (5,)), 10)
    assert status.state == "succeeded"
    assert perceiving.present()[0].parameters == (5,)
    repairing.cancel()


@bus_test
async def test_a_status_does_not_wait_for_ever_for_a_percept_that_was_lost(connect: Connect) -> None:
    async def serve(query: Query[Action]) -> None:
        answer(query, "succeeded", header=header, result=True, after=99)

    header = Perception(name="x").header
    action_requests, perceiving, *_ = await act(connect, serve)
    status = await action_requests.perform(request("takeoff", (5,)), 10)
    assert status.state == "succeeded"
    assert perceiving.counters["late"] == 1


@bus_test
async def test_an_action_that_was_dropped_while_the_bridge_was_out_of_reach_is_not_asked_for_again(
    connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commd.client.actions.RETRY", 0.5)
    begun: list[str] = []

    async def begin(query: Query[Action]) -> None:
        assert query.record is not None
        begun.append(query.record.id)
        answer(query, "succeeded", result=True)

    async def know_nothing(query: Query[Cancel]) -> None:
        answer(query, "refused", result=False, reason="no such action")

    action_requests, _, bridge, _ = await act(connect, None)
    action_client = asyncio.create_task(action_requests.perform(request("takeoff", (5,)), 30))
    await until(lambda: action_requests.counters["asked_again"] > 0, "the first attempt reached nobody")
    bridge.serve(keys.cancel(FLEET, "uav"), Cancel, know_nothing)
    bridge.serve(keys.action(FLEET, "uav", "*"), Action, begin)
    await action_requests.cancel("uav:b:1")
    status = await asyncio.wait_for(action_client, 120)
    assert (status.state, begun) == ("cancelled", [])


@bus_test
async def test_a_cancellation_that_a_busy_bridge_turns_away_is_asked_for_again(connect: Connect) -> None:
    asked: list[str] = []

    async def turn_away_once(query: Query[Cancel]) -> None:
        assert query.record is not None
        assert query.record.header.source == "uav", "the bridge asks who it is"
        asked.append(query.record.id)
        if len(asked) == 1:
            query.reply_error("busy: too many queries at once")
        else:
            answer(query, "cancelled", result=False)

    action_requests, _, bridge, _ = await act(connect, None)
    bridge.serve(keys.cancel(FLEET, "uav"), Cancel, turn_away_once)
    await action_requests.cancel("uav:b:1")
    assert asked == ["uav:b:1", "uav:b:1"]


@bus_test
async def test_an_argument_that_no_wire_carries_fails_the_action_at_once(connect: Connect) -> None:
    action_requests, *_ = await act(connect, None)
    status = await asyncio.wait_for(action_requests.perform(request("set_mode", ("\ud800",)), 30), 120)
    assert status.state == "failed"
    assert status.reason.startswith("cannot be sent: Action:")


@bus_test
async def test_an_action_may_take_as_long_as_its_bridge_says_and_no_longer(
    connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commd.client.actions.ASKERS_MARGIN", 0.2)

    async def serve(query: Query[Action]) -> None:
        answer(query, "accepted", deadline=0.3)
        await asyncio.sleep(0.4)
        answer(query, "running", deadline=0.3)
        await asyncio.sleep(60)

    action_requests, *_ = await act(connect, serve)
    began = asyncio.get_running_loop().time()
    status = await asyncio.wait_for(action_requests.perform(request("goto", (1, 2, 3)), patience=20), 120)
    assert (status.state, status.reason) == ("failed", "no outcome within its deadline")
    took = asyncio.get_running_loop().time() - began
    assert took > 0.8
    assert in_time(took, 10)
    assert action_requests.counters["asked_again"] == 0


@bus_test
async def test_what_the_callers_function_for_statuses_raises_reaches_the_caller(connect: Connect) -> None:
    async def serve(query: Query[Action]) -> None:
        answer(query, "accepted", deadline=600.0)
        await asyncio.sleep(60)

    def fail(status: ActionStatus) -> None:
        raise ValueError(f"cannot show {status.state}")

    action_requests, *_ = await act(connect, serve)
    with pytest.raises(ValueError, match="cannot show accepted"):
        await action_requests.perform(request("land"), patience=1, on_status=fail)


@bus_test
async def test_a_defect_in_who_hears_an_end_or_a_status_keeps_no_action_from_its_end(connect: Connect) -> None:
    defects, ends = list[str](), list[ActionStatus]()
    asyncio.get_running_loop().set_exception_handler(lambda _, context: defects.append(str(context["exception"])))

    async def serve(query: Query[Action]) -> None:
        answer(query, "running")
        await asyncio.sleep(600)

    def fail(status: ActionStatus) -> None:
        raise ValueError(status.state)

    action_requests, *_ = await act(connect, serve)
    action_requests.begin(request("goto"), fail, patience=0.5)
    action_requests.begin(request("land", (), "uav:b:2"), ends.append, patience=0.5, on_status=fail)
    await until(lambda: bool(ends), "the other one ends too")
    assert ends[0].reason == "the bridge has not taken it within 0.5 s"
    assert sorted(defects) == ["failed", "running"]


@bus_test
async def test_after_the_close_no_end_is_reported(connect: Connect, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("commd.client.actions.AFTER_PATIENCE", 0.3)

    async def serve(query: Query[Action]) -> None:
        answer(query, "succeeded", result=True, after=99, header=Header(boot="its life"))

    ends = list[ActionStatus]()
    action_requests, perceiving, *_ = await act(connect, serve)
    perceiving.percepts.boot = "its life"
    action_requests.begin(request("land"), ends.append)
    await until(lambda: bool(perceiving._waiting), "the end waits for the percepts before it")
    action_requests.close()
    await until(lambda: perceiving.counters["late"] == 1, "it has waited for long enough")
    assert ends == []


@bus_test
async def test_a_bridge_that_does_not_take_an_action_is_not_waited_for(connect: Connect) -> None:
    async def serve(query: Query[Action]) -> None:
        await asyncio.sleep(60)

    action_requests, *_ = await act(connect, serve)
    status = await asyncio.wait_for(action_requests.perform(request("land"), patience=0.5), 120)
    assert (status.state, status.reason) == ("failed", "the bridge has not taken it within 0.5 s")


@bus_test
async def test_a_bridge_that_is_there_and_says_nothing_fails_what_it_does_and_is_back_when_it_speaks(
    connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commd.liveness.bridge_presence.SILENT_AFTER", 2.0)

    async def serve(query: Query[Action]) -> None:
        answer(query, "accepted", deadline=1000.0)
        await asyncio.sleep(1000)

    action_requests, _, bridge, watch = await act(connect, serve)
    looking = asyncio.create_task(watch.run())
    key = keys.health(FLEET, "uav1", "bridged")
    await subscribed(bridge, key)
    said = list[Health]()
    (await connect("eye")).subscribe(key, Health, lambda _, health: said.append(health))
    speaking = asyncio.create_task(report_health(bridge, "uav1", Clock()))
    doing = asyncio.create_task(action_requests.perform(request("goto"), 10))
    await until(lambda: len(said) > 3, "it speaks for longer than it may be silent")
    assert watch.up, "a bridge that speaks is not given up"
    assert not doing.done()
    speaking.cancel()
    status = await asyncio.wait_for(doing, 120)
    assert (status.state, status.reason) == (
        "failed",
        "bridge_lost: the bridge is alive but sends no health records: it hangs",
    )
    assert not watch.up
    status = await asyncio.wait_for(action_requests.perform(request("goto", (), "uav:b:2"), 1000), 120)
    assert status.reason == "bridge_lost: the bridge is alive but sends no health records: it hangs"
    speaking = asyncio.create_task(report_health(bridge, "uav1", Clock()))
    await until(lambda: watch.up and not watch.hangs, "the bridge is back")
    speaking.cancel()
    looking.cancel()


@bus_test
async def test_what_has_failed_for_the_agent_or_was_dropped_while_its_bridge_was_away_is_cancelled_when_it_is_back(
    connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commd.client.actions.BUS_GRACE", 0.5)
    cancelled: list[str] = []

    async def serve(query: Query[Action]) -> None:
        answer(query, "accepted", deadline=600.0)
        await asyncio.sleep(60)

    async def end(query: Query[Cancel]) -> None:
        assert query.record is not None
        cancelled.append(query.record.id)
        answer(query, "cancelled", result=False)

    action_requests, _, bridge, watch = await act(connect, serve)
    accepted, ends = asyncio.Event(), list[ActionStatus]()
    action_requests.begin(request("goto"), ends.append, on_status=lambda status: accepted.set())
    await asyncio.wait_for(accepted.wait(), 60)
    await bridge.close()  # as one that is stopped, which goes on with the action later
    await until(lambda: bool(ends), "the agent is told")
    assert ends[0].reason.startswith("bridge_lost: ")
    await action_requests.cancel("uav:b:2")
    assert action_requests.counters["cancels_unanswered"] == 1
    back = await connect("uav1", "bridged")
    back.serve(keys.cancel(FLEET, "uav"), Cancel, end)
    await back.claim("uav1")
    await until(lambda: len(cancelled) == 2, "the bridge ends both")
    assert sorted(cancelled) == ["uav:b:1", "uav:b:2"]
    watch.came[0]()
    await asyncio.sleep(0.1)
    assert len(cancelled) == 2, "once"


@bus_test
async def test_of_several_actions_that_end_without_an_outcome_each_is_cancelled_once(
    connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commd.client.actions.ASKERS_MARGIN", 0.0)
    cancelled: list[str] = []

    async def serve(query: Query[Action]) -> None:
        answer(query, "accepted", deadline=0.5)
        await asyncio.sleep(60)

    def end(query: Query[Cancel]) -> None:
        assert query.record is not None
        cancelled.append(query.record.id)
        answer(query, "cancelled", result=False)

    action_requests, _, bridge, _ = await act(connect, serve)
    bridge.serve(keys.cancel(FLEET, "uav"), Cancel, end)
    ends: list[ActionStatus] = []
    for number in range(1, 4):
        action_requests.begin(request("goto", (), f"uav:b:{number}"), ends.append)
    await until(lambda: len(ends) == 3 and not action_requests._tasks, "all have failed, and are cancelled")
    assert {one.state for one in ends} <= {"failed", "timed_out"}
    assert sorted(cancelled) == ["uav:b:1", "uav:b:2", "uav:b:3"]
