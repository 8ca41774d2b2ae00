"""An action from the agent's side: one final status, whatever happens to the bridge; waits are in virtual time."""

import asyncio
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
from schemas.liveness import SILENT_AFTER
from schemas.wire import keys
from schemas.wire.records import Action, ActionStatus, Cancel, Header, Health, Perception, Perceptions, State
from schemas.wire.terms import Term
from tests.support.buses import FLEET, Connect, served, subscribed, under_way, until, virtual_bus_test

HANG = 600.0
"""Seconds of a script, longer than any test."""
Step = State | dict[str, Any] | float
"""Of a script: a status that is replied, by its state or its fields, or seconds that pass."""


def request(name: str, parameters: tuple[Term, ...] = (), identity: str = "uav:b:1") -> Action:
    return Action(id=identity, agent="uav", name=name, parameters=parameters)


def altitude(header: Header, metres: float) -> Perception:
    """Return what a bridge says of an altitude."""
    return Perception(header=header, name="altitude", parameters=(metres,))


class Acting:
    """An agent's side of actions before a bridge that answers by scripts, and what the bridge was asked."""

    def __init__(self, bridge: Bus, agent: Bus, scripts: tuple[list[Step], ...]) -> None:
        self.bridge, self._scripts = bridge, scripts
        self.asked: list[tuple[str, int]] = []
        """Identity and attempt of each request."""
        self.cancelled: list[str] = []
        self.perceiving = PerceptSync(agent, "uav", "uav1", lambda one: None)
        self.watch = BridgePresence(agent, "uav1", lambda: None, lambda: None)
        self.requests = ActionRequests(agent, "uav", self.perceiving, self.watch)

    def perform(self, name: str, patience: float = 30, **more: Any) -> asyncio.Task[ActionStatus]:
        """Perform an action; it ends within a bound."""
        identity = more.pop("identity", "uav:b:1")
        performing = self.requests.perform(request(name, more.pop("parameters", ()), identity), patience, **more)
        return asyncio.create_task(asyncio.wait_for(performing, 120))

    async def serve(self, query: Query[Action]) -> None:
        """Answer by the script for as many requests as there were, the last one for all further ones."""
        self.asked.append((query.record.id, query.record.attempt))
        for step in self._scripts[min(len(self.asked), len(self._scripts)) - 1]:
            if isinstance(step, float):
                await asyncio.sleep(step)
            else:
                fields: dict[str, Any] = {"state": step} if isinstance(step, str) else step
                query.reply(ActionStatus(id=query.record.id, **fields))

    def serve_cancellations(self, bus: Bus, *answers: str | ActionStatus) -> None:
        """Answer cancellations on `bus`: by `answers` first, each an error or a status, then that it is cancelled."""
        left = list(answers)

        def cancel(query: Query[Cancel]) -> None:
            assert query.record.header.source == "uav", "the bridge asks who it is"
            self.cancelled.append(query.record.id)
            answer = left.pop(0) if left else ActionStatus(id=query.record.id, state="cancelled", result=False)
            query.reply_error(answer) if isinstance(answer, str) else query.reply(answer)

        bus.serve(keys.cancel(FLEET, "uav"), Cancel, cancel)


async def act(connect: Connect, *scripts: list[Step]) -> Acting:
    """Return an agent's side of actions, with a bridge that serves them by scripts, or serves none without any."""
    bridge, bus = await connect("uav1", "bridged"), await connect("uav")
    acting = Acting(bridge, bus, scripts)
    if scripts:
        bridge.serve(keys.action(FLEET, "uav", "*"), Action, acting.serve)
        await served(bus, keys.action(FLEET, "uav", "*"))
    await bridge.claim("uav1")
    await until(lambda: acting.watch.up, "the bridge is seen")
    return acting


async def test_an_action_ends_with_the_bridges_own_final_status(connect: Connect) -> None:
    acting = await act(connect, ["accepted", {"state": "refused", "reason": "Arm: RTL mode not armable"}])
    status = await acting.perform("arm_motors", parameters=(True,))
    assert (status.state, status.reason) == ("refused", "Arm: RTL mode not armable")
    assert acting.requests.counters["asked_again"] == 0


async def test_an_answer_that_breaks_off_is_asked_for_again_with_the_same_id(connect: Connect) -> None:
    acting = await act(connect, ["running"], ["running"], ["succeeded"])
    assert (await acting.perform("land")).state == "succeeded"
    assert acting.asked == [("uav:b:1", 1), ("uav:b:1", 2), ("uav:b:1", 3)]


@virtual_bus_test
async def test_an_action_of_which_nothing_is_heard_for_three_periods_is_asked_for_again(connect: Connect) -> None:
    acting = await act(connect, [{"state": "accepted", "deadline": 600.0}, HANG], ["succeeded"])
    assert (await acting.perform("land")).state == "succeeded"
    assert acting.asked == [("uav:b:1", 1), ("uav:b:1", 2)]


@virtual_bus_test
async def test_a_bridge_slow_to_take_an_action_has_its_time_and_is_asked_by_the_same_attempt(connect: Connect) -> None:
    acting = await act(connect, *[[HANG]] * 5, ["succeeded"])
    assert (await acting.perform("land")).state == "succeeded"
    assert acting.asked == [("uav:b:1", 1)] * 6


@virtual_bus_test
async def test_an_action_whose_statuses_stopped_before_the_loss_of_the_router_was_noticed_has_the_grace_from_then(
    connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commd.client.actions.BUS_GRACE", 0.5)
    acting = await act(connect, ["running", HANG], ["succeeded"])
    flying = acting.perform("goto", 60)
    await until(lambda: acting.asked, "it runs")
    await asyncio.sleep(1)  # longer than the grace
    bus = acting.requests._bus
    for zid in bus._routers.copy():
        for kind in (zenoh.SampleKind.DELETE, zenoh.SampleKind.PUT):
            event = SimpleNamespace(kind=kind, transport=SimpleNamespace(zid=zid))
            bus._router_event(cast(zenoh.TransportEvent, event))
    assert (await flying).state == "succeeded"
    assert acting.asked == [("uav:b:1", 1), ("uav:b:1", 2)]


@virtual_bus_test
async def test_an_action_that_nobody_serves_or_takes_fails_after_its_time(connect: Connect) -> None:
    acting = await act(connect)
    status = await acting.perform("land")
    assert (status.state, status.result) == ("failed", False)
    assert status.reason == "bridge_lost: nobody serves this action"
    acting._scripts = ([HANG],)
    acting.bridge.serve(keys.action(FLEET, "uav", "*"), Action, acting.serve)
    await served(acting.requests._bus, keys.action(FLEET, "uav", "*"))
    status = await acting.perform("land", 0.5)
    assert (status.state, status.reason) == ("failed", "the bridge has not taken it within 0.5 s")


@virtual_bus_test
async def test_a_dead_bridge_fails_the_action_and_says_so(connect: Connect) -> None:
    acting = await act(connect, ["running", HANG])
    flying = acting.perform("goto")
    await until(lambda: acting.asked, "it runs")
    await acting.bridge.close()
    status = await flying
    assert (status.state, status.reason) == ("failed", "bridge_lost: the bridge of this robot is not running")


@virtual_bus_test
async def test_a_status_waits_for_the_percept_that_it_follows(connect: Connect) -> None:
    acting = await act(connect)
    bridge, perceiving = acting.bridge, acting.perceiving

    async def serve(query: Query[Action]) -> None:
        header = bridge.header("percept")
        query.reply(ActionStatus(id="uav:b:1", state="succeeded", header=header, result=True, after=header.seq))
        await asyncio.sleep(0.1)  # the percept comes after the status that follows it
        bridge.put(keys.percepts(FLEET, "uav"), Perceptions(changes=(altitude(header, 5),)))

    bridge.serve(keys.action(FLEET, "uav", "*"), Action, serve)
    await subscribed(bridge, keys.percepts(FLEET, "uav"))
    bridge.put(keys.percepts(FLEET, "uav"), Perceptions(changes=(altitude(bridge.header("percept"), 0),)))
    await until(lambda: perceiving.percepts.seq == 1, "the first percept arrives")
    assert (await acting.perform("takeoff")).state == "succeeded"
    assert perceiving.percepts.present()[0].parameters == (5,)
    assert perceiving.counters["late"] == 0


@virtual_bus_test
async def test_a_status_waits_until_a_percept_that_was_lost_before_it_is_repaired(connect: Connect) -> None:
    acting = await act(connect)
    bridge, perceiving = acting.bridge, acting.perceiving
    present = [altitude(bridge.header("percept"), 0)]

    async def repair(query: Query[Perception]) -> None:
        query.reply(present[0], keys.percept(FLEET, "uav", "altitude"))

    async def serve(query: Query[Action]) -> None:
        header = bridge.header("percept")
        present[:] = [altitude(header, 5)]  # its put is lost
        query.reply(ActionStatus(id="uav:b:1", state="succeeded", header=header, result=True, after=header.seq))
        asyncio.get_running_loop().call_later(1.0, perceiving.doubt)  # as by the next health

    bridge.serve(keys.percept(FLEET, "uav", "**"), Perception, repair)
    bridge.serve(keys.action(FLEET, "uav", "*"), Action, serve)
    async with under_way(perceiving.run()):
        # The first query may be earlier than the bridge's declaration is known here: health has it repeated.
        await until(lambda: perceiving.percepts.seq == 1 or perceiving.doubt(), "the first percept arrives")
        assert (await acting.perform("takeoff")).state == "succeeded"
        assert perceiving.present()[0].parameters == (5,)


@virtual_bus_test
async def test_a_status_does_not_wait_for_ever_for_a_percept_that_was_lost(connect: Connect) -> None:
    acting = await act(connect, [{"state": "succeeded", "after": 99}])
    assert (await acting.perform("takeoff")).state == "succeeded"
    assert acting.perceiving.counters["late"] == 1


@virtual_bus_test
async def test_an_action_dropped_while_the_bridge_was_out_of_reach_is_not_asked_for_again(connect: Connect) -> None:
    acting = await act(connect)
    performing = acting.perform("takeoff")
    await until(lambda: acting.requests.counters["asked_again"] > 0, "the first attempt reached nobody")
    unknown = ActionStatus(id="uav:b:1", state="refused", result=False, reason="no such action")
    acting.serve_cancellations(acting.bridge, unknown)
    acting.bridge.serve(keys.action(FLEET, "uav", "*"), Action, acting.serve)
    await acting.requests.cancel("uav:b:1")
    assert ((await performing).state, acting.asked) == ("cancelled", [])


async def test_a_cancellation_that_a_busy_bridge_turns_away_is_asked_for_again(connect: Connect) -> None:
    acting = await act(connect)
    acting.serve_cancellations(acting.bridge, "busy: too many queries at once")
    await acting.requests.cancel("uav:b:1")
    assert acting.cancelled == ["uav:b:1", "uav:b:1"]


async def test_an_argument_that_no_wire_carries_fails_the_action_at_once(connect: Connect) -> None:
    status = await (await act(connect)).perform("set_mode", parameters=("\ud800",))
    assert status.state == "failed"
    assert status.reason.startswith("cannot be sent: Action:")


@virtual_bus_test
async def test_an_action_may_take_as_long_as_its_bridge_says(connect: Connect, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("commd.client.actions.ASKERS_MARGIN", 0.2)
    said = {"deadline": 0.3}
    acting = await act(connect, [{"state": "accepted", **said}, 0.4, {"state": "running", **said}, HANG])
    began = asyncio.get_running_loop().time()
    status = await acting.perform("goto", 20)
    assert (status.state, status.reason) == ("failed", "no outcome within its deadline")
    assert asyncio.get_running_loop().time() - began == pytest.approx(0.4 + 0.3 + 0.2, abs=0.02)
    assert acting.requests.counters["asked_again"] == 0


def fail(status: ActionStatus) -> None:
    """Be a function of a caller with a defect."""
    raise ValueError(f"cannot show {status.state}")


async def test_what_the_callers_function_for_statuses_raises_reaches_the_caller(connect: Connect) -> None:
    acting = await act(connect, [{"state": "accepted", "deadline": 600.0}, HANG])
    with pytest.raises(ValueError, match="cannot show accepted"):
        await acting.perform("land", 1, on_status=fail)


@virtual_bus_test
async def test_a_defect_in_who_hears_an_end_or_a_status_keeps_no_action_from_its_end(connect: Connect) -> None:
    defects, ends = list[str](), list[ActionStatus]()
    asyncio.get_running_loop().set_exception_handler(lambda _, context: defects.append(str(context["exception"])))
    acting = await act(connect, ["running", HANG])
    acting.requests.begin(request("goto"), fail, patience=0.5)
    acting.requests.begin(request("land", (), "uav:b:2"), ends.append, patience=0.5, on_status=fail)
    await until(lambda: bool(ends), "the other one ends too")
    assert ends[0].reason == "the bridge has not taken it within 0.5 s"
    assert sorted(defects) == ["cannot show failed", "cannot show running"]


@virtual_bus_test
async def test_after_the_close_no_end_is_reported(connect: Connect) -> None:
    header, ends = Header(boot="its life"), list[ActionStatus]()
    acting = await act(connect, [{"state": "succeeded", "result": True, "after": 99, "header": header}])
    acting.perceiving.percepts.boot = "its life"
    acting.requests.begin(request("land"), ends.append)
    await until(lambda: bool(acting.perceiving._waiting), "the end waits for the percepts before it")
    acting.requests.close()
    await until(lambda: acting.perceiving.counters["late"] == 1, "it has waited for long enough")
    assert ends == []


@virtual_bus_test
async def test_a_bridge_that_says_nothing_fails_what_it_does_and_is_back_when_it_speaks(connect: Connect) -> None:
    acting = await act(connect, [{"state": "accepted", "deadline": 1000.0}, HANG])
    key = keys.health(FLEET, "uav1", "bridged")
    await subscribed(acting.bridge, key)
    said = list[Health]()
    (await connect("eye")).subscribe(key, Health, lambda _, health: said.append(health))
    silent = ("failed", "bridge_lost: the bridge is alive but sends no health records: it hangs")
    async with under_way(acting.watch.run()):
        async with under_way(report_health(acting.bridge, "uav1", Clock())):
            doing = acting.perform("goto")
            await until(lambda: len(said) > SILENT_AFTER + 1, "it speaks for longer than it may be silent")
            assert acting.watch.up, "a bridge that speaks is not given up"
            assert not doing.done()
        for status in (await doing, await acting.perform("goto", 1000, identity="uav:b:2")):
            assert (status.state, status.reason) == silent
            assert not acting.watch.up
        async with under_way(report_health(acting.bridge, "uav1", Clock())):
            await until(lambda: acting.watch.up and not acting.watch.hangs, "the bridge is back")


@virtual_bus_test
async def test_what_has_failed_for_the_agent_or_was_dropped_while_its_bridge_was_away_is_cancelled_when_it_is_back(
    connect: Connect,
) -> None:
    acting = await act(connect, [{"state": "accepted", "deadline": 600.0}, HANG])
    accepted, ends = asyncio.Event(), list[ActionStatus]()
    acting.requests.begin(request("goto"), ends.append, on_status=lambda status: accepted.set())
    await asyncio.wait_for(accepted.wait(), 60)
    await acting.bridge.close()  # as one that is stopped, which goes on with the action later
    await until(lambda: bool(ends), "the agent is told")
    assert ends[0].reason.startswith("bridge_lost: ")
    await acting.requests.cancel("uav:b:2")
    assert acting.requests.counters["cancels_unanswered"] == 1
    back = await connect("uav1", "bridged")
    acting.serve_cancellations(back)
    await back.claim("uav1")
    await until(lambda: len(acting.cancelled) == 2 and not acting.requests._tasks, "the bridge ends both, and says so")
    assert sorted(acting.cancelled) == ["uav:b:1", "uav:b:2"]
    acting.watch.came[0]()
    await until(lambda: not acting.requests._tasks, "nothing is left to cancel")
    assert len(acting.cancelled) == 2, "once"


@virtual_bus_test
async def test_of_several_actions_that_end_without_an_outcome_each_is_cancelled_once(
    connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commd.client.actions.ASKERS_MARGIN", 0.0)
    acting, ends = await act(connect, [{"state": "accepted", "deadline": 0.5}, HANG]), list[ActionStatus]()
    acting.serve_cancellations(acting.bridge)
    for number in range(1, 4):
        acting.requests.begin(request("goto", (), f"uav:b:{number}"), ends.append)
    await until(lambda: len(ends) == 3 and not acting.requests._tasks, "all have failed, and are cancelled")
    assert {one.state for one in ends} <= {"failed", "timed_out"}
    assert sorted(acting.cancelled) == ["uav:b:1", "uav:b:2", "uav:b:3"]
