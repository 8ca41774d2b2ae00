"""What the buttons do: orders to robots and to minds, and their outcome as it is, never better."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest

import argosy.ui.page_requests
from argosy.cli.operator_bus import Where
from argosy.fleet_model.mission_clock import steady_clock
from commd.bus.bus import Bus
from schemas.mission.model import load_mission
from schemas.wire.records import Outcome
from tests.argosy.ui.fleets import fleet, router
from tests.argosy.ui.serving import Browser, served
from tests.support.buses import until

MISSION = """\
mission: sar
agents: {scout: {program: scout.asl, robot: uav1}}
robots:
  uav1: {manifest: turtle}
  uav9: {manifest: turtle}
security: {observers: [eye], operators: [ops]}
"""


async def linked(browser: Browser, *members: str) -> None:
    """Let the browser in, and the server find its fleet."""
    await browser.enter()
    model = browser.following.model

    def there() -> bool:
        every = model.robots | model.agents
        return browser.following.link.up and all(name in every and every[name].there for name in members)

    await until(there, f"the server sees {members}")


async def posted(browser: Browser, path: str, wish: object) -> dict[str, object]:
    status, text = await browser.post(path, wish)
    assert status == 200, text
    told: dict[str, object] = json.loads(text)
    return told


def test_an_order_to_all_is_told_for_each_robot_as_it_is(endpoint: str) -> None:
    answers = {
        "uav1": Outcome(ok=True, reason="mode RTL"),
        "uav2": Outcome(ok=False, reason="the vehicle stays in AUTO"),
    }

    async def body() -> None:
        async with fleet(endpoint, answers) as (robots, _), served(Where("sar", endpoint)) as browser:
            await linked(browser, "uav1", "uav2")
            told = await posted(browser, "/stop", {"order": "rtl", "robots": None})
            assert told["outcomes"] == {
                "uav1": ["confirmed", "mode RTL"],
                "uav2": ["NOT confirmed", "the vehicle stays in AUTO"],
            }
            assert [one.orders for one in robots] == [["rtl"], ["rtl"]]
            async with browser.feed() as feed:  # other pages see it, too
                shown = await feed.until("order/1", order="rtl", of="all")
                assert shown["outcomes"] == told["outcomes"]

    asyncio.run(body())


def test_an_order_to_one_robot_goes_to_that_one_alone(endpoint: str) -> None:
    async def body() -> None:
        async with (
            fleet(endpoint, {"uav1": Outcome(ok=True), "uav2": Outcome(ok=True)}) as ([uav1, uav2], _),
            served(Where("sar", endpoint)) as browser,
        ):
            await linked(browser, "uav1", "uav2")
            told = await posted(browser, "/stop", {"order": "hold", "robots": ["uav2"]})
            assert told["outcomes"] == {"uav2": ["confirmed", ""]}
            assert (uav1.orders, uav2.orders) == ([], ["hold"])

    asyncio.run(body())


def test_a_robot_of_the_mission_whose_bridge_is_not_there_is_named_as_not_confirmed(
    endpoint: str, tmp_path: Path
) -> None:
    (tmp_path / "mission.yaml").write_text(MISSION)
    mission = load_mission(tmp_path / "mission.yaml")

    async def body() -> None:
        async with (
            fleet(endpoint, {"uav1": Outcome(ok=True)}),
            served(Where("sar", endpoint), mission) as browser,
        ):
            await linked(browser, "uav1")
            told = await posted(browser, "/stop", {"order": "hold", "robots": None})
            assert told["outcomes"] == {
                "uav1": ["confirmed", ""],
                "uav9": ["NOT confirmed", "its bridge is not on the bus"],
            }

    asyncio.run(body())


def test_without_a_router_nobody_was_told(endpoint: str) -> None:
    async def body() -> None:
        async with served(Where("sar", endpoint)) as browser:
            await browser.enter()
            told = await posted(browser, "/stop", {"order": "hold", "robots": None})
            assert told["problem"] == "the router is not reached: the order was not sent"
            assert "outcomes" not in told
            answer = await posted(browser, "/control", {"agent": "scout", "do": "pause"})
            assert answer == {"ok": False, "reason": "the router is not reached: the order was not sent"}
            assert (await posted(browser, "/why", {"agent": "scout"}))["error"] == "the router is not reached"

    asyncio.run(body())


def test_when_no_robot_is_there_an_order_to_all_says_so(endpoint: str) -> None:
    async def body() -> None:
        async with router(endpoint), served(Where("sar", endpoint)) as browser:
            await linked(browser)
            assert (await posted(browser, "/stop", {"order": "land"}))["problem"] == "no robot is on the bus"

    asyncio.run(body())


def test_an_observer_sees_and_orders_nothing(endpoint: str, tmp_path: Path) -> None:
    (tmp_path / "mission.yaml").write_text(MISSION)
    mission = load_mission(tmp_path / "mission.yaml")
    why = "`eye` is an observer in the mission: it may not give orders"

    async def body() -> None:
        async with (
            fleet(endpoint, {"uav1": Outcome(ok=True)}) as ([uav1], [scout]),
            served(Where("sar", endpoint), mission, identity="eye") as browser,
        ):
            await linked(browser)
            async with browser.feed() as feed:
                await feed.until("head", observer=why, identity="eye")
                await feed.until("robot/uav1", standing="up")
            assert (await posted(browser, "/stop", {"order": "hold"}))["problem"] == why
            assert await posted(browser, "/control", {"agent": "scout", "do": "pause"}) == {"ok": False, "reason": why}
            assert (uav1.orders, scout.ordered) == ([], [])

    asyncio.run(body())


def test_minds_take_orders_and_refuse_them_in_words(endpoint: str) -> None:
    async def body(inject: bool) -> None:
        async with (
            fleet(endpoint, {"uav1": Outcome(ok=True)}, inject=inject) as (_, [scout]),
            served(Where("sar", endpoint)) as browser,
        ):
            await linked(browser, "scout")
            told = await posted(browser, "/control", {"agent": "scout", "do": "goal", "text": " go(3,4) "})
            if inject:
                assert told == {"ok": True}
                assert [(one.do, one.text) for one in scout.ordered] == [("goal", "go(3,4)")]
            else:
                assert told == {"ok": False, "reason": "the mission does not say `inject: true`"}

    asyncio.run(body(inject=True))
    asyncio.run(body(inject=False))


def test_what_no_mind_can_take_is_refused_before_it_is_sent(endpoint: str) -> None:
    async def body() -> None:
        async with fleet(endpoint, {}) as (_, [scout]), served(Where("sar", endpoint)) as browser:
            await linked(browser, "scout")
            empty = await posted(browser, "/control", {"agent": "scout", "do": "goal", "text": "  "})
            assert empty == {"ok": False, "reason": "expected a goal, such as `go(3,4)`"}
            long = await posted(browser, "/control", {"agent": "scout", "do": "belief", "text": "x" * 4_001})
            assert long == {"ok": False, "reason": "4001 characters, expected at most 4000"}
            nobody = await posted(browser, "/control", {"agent": "ghost", "do": "pause"})
            assert nobody == {"ok": False, "reason": "`ghost` did not answer: is it running?"}
            assert scout.ordered == []

    asyncio.run(body())


def test_names_that_are_no_names_reach_nobody(endpoint: str) -> None:
    async def body() -> None:
        async with (
            fleet(endpoint, {"uav1": Outcome(ok=True), "uav2": Outcome(ok=True)}) as (robots, [scout]),
            served(Where("sar", endpoint)) as browser,
        ):
            await linked(browser)
            for name in ("*", "**", "uav1/stop", "", "a?b", "$*"):
                told = await posted(browser, "/stop", {"order": "rtl", "robots": [name]})
                assert told["problem"] == f"`{name}` is no name of a robot"
                refused = await posted(browser, "/control", {"agent": name, "do": "pause"})
                assert refused == {"ok": False, "reason": f"`{name}` is no name of an agent"}
                assert (await posted(browser, "/why", {"agent": name}))["error"] == f"`{name}` is no name of an agent"
            assert [one.orders for one in robots] == [[], []]
            assert scout.ordered == []

    asyncio.run(body())


def test_a_silent_agent_or_an_unreadable_question_is_told_in_words(endpoint: str) -> None:
    async def body() -> None:
        async with fleet(endpoint, {}) as (_, [scout]), served(Where("sar", endpoint)) as browser:
            await linked(browser, "scout")
            assert scout.name == "scout"
            assert "expected the name of a goal" in str(
                (await posted(browser, "/why", {"agent": "scout", "about": "(("}))["error"]
            )
            found = await posted(browser, "/why", {"agent": "scout"})
            assert found["explanation"]

    asyncio.run(body())


def test_an_order_that_comes_late_or_from_a_clock_that_is_not_ours_is_refused_in_words(endpoint: str) -> None:
    async def body() -> None:
        async with (
            fleet(endpoint, {"uav1": Outcome(ok=True)}) as ([uav1], [scout]),
            served(Where("sar", endpoint)) as browser,
        ):
            await linked(browser, "uav1", "scout")
            told = await posted(browser, "/stop", {"order": "hold", "at": steady_clock() - 8})
            assert told["state"] == "NOT ordered"
            assert told["problem"] == "it came 8 s after it was given and was not carried out: order again"
            told = await posted(browser, "/stop", {"order": "hold", "at": steady_clock() + 60})
            assert "60 s before it was given, by our clock" in str(told["problem"])
            told = await posted(browser, "/control", {"agent": "scout", "do": "pause", "at": steady_clock() - 8})
            assert told["ok"] is False
            assert "8 s after it was given" in str(told["reason"])
            assert (await browser.post("/stop", {"order": "hold", "at": None}))[0] == 400
            assert (uav1.orders, scout.ordered) == ([], [])

    asyncio.run(body())


def test_an_order_that_was_cut_off_is_not_waited_for_by_its_pages(
    endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def fails(_bus: Bus, _fleet: str) -> list[tuple[str, str]]:
        raise OSError("the session went")

    async def body() -> None:
        async with fleet(endpoint, {"uav1": None}), served(Where("sar", endpoint)) as browser:
            await linked(browser, "uav1")
            monkeypatch.setattr(argosy.ui.page_requests, "bridges", fails)
            assert (await browser.post("/stop", {"order": "hold"}))[0] == 500
            [view] = browser.following.orders.last
            assert view.state == "NOT confirmed"
            assert view.outcomes == {"uav1": ("NOT confirmed", "interrupted: NOT known whether it was carried out")}

    asyncio.run(body())
