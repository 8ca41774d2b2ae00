"""The watcher of a fleet on a real bus."""

import asyncio
from contextlib import AsyncExitStack

from argosy.fleet_model.mission_clock import steady_clock
from argosy.fleet_model.model import FleetModel
from argosy.fleet_model.observer import AT_ONCE, FleetObserver, Wanted
from commd.bus.bus import Bus, open_bus
from schemas.wire import keys
from schemas.wire.mind_records import MindView
from tests.argosy.beside import crowd_of
from tests.argosy.fleet_model.crowd import FLEET
from tests.support.buses import session, until


async def _observer(stack: AsyncExitStack, endpoint: str) -> Bus:
    opening = open_bus(endpoint, fleet="operator", name="operator", daemon="argosy")
    return await stack.enter_async_context(opening)


async def test_a_fleet_that_nobody_named_is_found_and_its_minds_are_looked_into(endpoint: str) -> None:
    async with AsyncExitStack() as stack:
        await stack.enter_async_context(session(endpoint, "board", "commd", router=True))
        model = FleetModel(steady_clock)
        watcher = FleetObserver(await _observer(stack, endpoint), model)
        watcher.start()
        stack.push_async_callback(watcher.stop)
        assert model.fleet == ""
        loop = asyncio.get_running_loop()
        crowd = crowd_of(3, endpoint)
        await loop.run_in_executor(None, crowd.__enter__)
        stack.callback(crowd.__exit__, None, None, None)
        await until(lambda: len(model.agents) == 3 and all(one.heard for one in model.agents.values()), "the minds")
        assert model.fleet == FLEET
        await until(lambda: model.agents["agent01"].robot == "uav01", "its robot, by the bridge's health")
        view = model.agents["agent01"].mind
        assert view.intentions[0].stack == ("+!visit(3)", "+!search")
        assert not view.beliefs, "a look at a mind that nobody looked at asks for no beliefs"
        assert model.agents["agent01"].detail is None
        watcher.look_at("agent01")
        await until(lambda: model.agents["agent01"].detail is not None, "the details")
        detail = model.agents["agent01"].detail
        assert len(detail.beliefs) == len(detail.plans) == 40
        await until(lambda: model.robots["uav02"].seen.mode == "GUIDED", "the vehicle")
        await until(lambda: bool(model.actions.open("agent02")), "the action")
        await until(lambda: model.mail_for("agent00") == 2, "the mail")
        await until(lambda: any(one.what == "sent" for one in model.timeline.entries), "the activity")
        assert any(one.name == "goto" for one in model.places.all.values())


async def test_in_a_large_fleet_each_mind_has_its_turn(endpoint: str) -> None:
    async with AsyncExitStack() as stack:
        await stack.enter_async_context(session(endpoint, "board", "commd", router=True))
        agents = await stack.enter_async_context(session(endpoint, "crowd"))
        model = FleetModel(steady_clock, fleet="test")
        watcher = FleetObserver(await _observer(stack, endpoint), model, "test", Wanted(minds_every=0.01))
        for name in (names := [f"agent{number}" for number in range(3 * AT_ONCE)]):
            agents.serve(key := keys.mind("test", name), MindView, lambda query, key=key: query.reply(MindView(), key))  # type: ignore[misc]
            agents.token(keys.alive("test", name, "agentd", "b"))
        watcher.start()
        stack.push_async_callback(watcher.stop)
        await until(lambda: len(model.agents) == len(names), "all are there")
        await until(lambda: all(one.mind is not None for one in model.agents.values()), "all are asked")


async def test_a_router_that_goes_is_said_at_once_and_the_fleet_is_seen_again_when_it_is_back(endpoint: str) -> None:
    async with AsyncExitStack() as stack:
        router = session(endpoint, "board", "commd", router=True)
        await router.__aenter__()
        agent = await stack.enter_async_context(session(endpoint, "uav"))
        agent.token(keys.alive("test", "uav", "agentd", "b"))
        model = FleetModel(steady_clock, fleet="test")
        watcher = FleetObserver(await _observer(stack, endpoint), model, "test")
        watcher.start()
        stack.push_async_callback(watcher.stop)
        await until(lambda: "uav" in model.agents and model.agents["uav"].there, "the agent")
        await router.__aexit__(None, None, None)
        await until(lambda: not model.router_up, "the router is lost")
        assert model.agents["uav"].there, "nobody knows that it has gone"
        async with session(endpoint, "board", "commd", router=True):
            await until(lambda: model.router_up, "the router is back")
            await until(lambda: agent.router_up, "the agent sees it")
            assert [one.who for one in model.timeline.entries if one.what == "went"] == []


async def test_who_looks_at_a_mind_is_counted(endpoint: str) -> None:
    async with AsyncExitStack() as stack:
        await stack.enter_async_context(session(endpoint, "board", "commd", router=True))
        watcher = FleetObserver(await _observer(stack, endpoint), FleetModel(steady_clock, fleet="test"), "test")
        for step in (watcher.look_at, watcher.look_at, watcher.look_away):
            step("uav")
        assert "uav" in watcher.looked_at
        watcher.look_away("uav")
        watcher.look_away("uav")
        assert "uav" not in watcher.looked_at
