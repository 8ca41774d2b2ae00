"""What the buttons do: orders to robots and to minds, and their outcome as it is, never better."""

import json
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

import argosy.ui.page_requests
from argosy.cli.operator_bus import Where
from argosy.fleet_model.mission_clock import steady_clock
from commd.bus.bus import Bus
from schemas.mission.model import Mission, read_mission
from schemas.wire import keys
from schemas.wire.records import Outcome, RunningMission
from tests.argosy.ui.fleets import Agent, Robot, fleet, router
from tests.argosy.ui.serving import Browser, entered
from tests.support.buses import until

FINE = Outcome(ok=True)
MISSION = read_mission(
    """\
mission: sar
agents: {scout: {program: scout.asl, robot: uav1}}
robots:
  uav1: {manifest: turtle}
  uav9: {manifest: turtle}
security: {observers: [eye], operators: [ops]}
""",
    Path("mission.yaml"),
)


@asynccontextmanager
async def commanded(
    endpoint: str,
    answers: Mapping[str, Outcome | None],
    mission: Mission | None = None,
    *,
    inject: bool = True,
    identity: str = "",
) -> AsyncIterator[tuple[Browser, list[Robot], Agent]]:
    """The page of a fleet whose server has found the robots of `answers` and the agent `scout`."""
    async with (
        fleet(endpoint, dict(answers), inject=inject) as (robots, [scout]),
        entered(Where("sar", endpoint), mission, identity=identity) as browser,
    ):
        following = browser.following

        def there() -> bool:
            every = following.model.robots | following.model.agents
            return following.link.up and all(name in every and every[name].there for name in (*answers, "scout"))

        await until(there, "the server sees robots and agent")
        yield browser, robots, scout


async def posted(browser: Browser, path: str, wish: object) -> dict[str, object]:
    status, text = await browser.post(path, wish)
    assert status == 200, text
    told: dict[str, object] = json.loads(text)
    return told


async def test_an_order_to_all_is_told_for_each_robot_as_it_is(endpoint: str) -> None:
    answers = {
        "uav1": Outcome(ok=True, reason="mode RTL"),
        "uav2": Outcome(ok=False, reason="the vehicle stays in AUTO"),
    }
    async with commanded(endpoint, answers) as (browser, robots, _):
        told = await posted(browser, "/stop", {"order": "rtl", "robots": None})
        assert told["outcomes"] == {
            "uav1": ["confirmed", "mode RTL"],
            "uav2": ["NOT confirmed", "the vehicle stays in AUTO"],
        }
        assert [one.orders for one in robots] == [["rtl"], ["rtl"]]
        async with browser.feed() as feed:  # other pages see it, too
            shown = await feed.until("order/1", order="rtl", of="all")
            assert shown["outcomes"] == told["outcomes"]


async def test_an_order_to_one_robot_goes_to_that_one_alone(endpoint: str) -> None:
    async with commanded(endpoint, {"uav1": FINE, "uav2": FINE}) as (browser, [uav1, uav2], _):
        told = await posted(browser, "/stop", {"order": "hold", "robots": ["uav2"]})
        assert told["outcomes"] == {"uav2": ["confirmed", ""]}
        assert (uav1.orders, uav2.orders) == ([], ["hold"])


async def test_a_robot_of_the_mission_whose_bridge_is_not_there_is_named_as_not_confirmed(endpoint: str) -> None:
    async with commanded(endpoint, {"uav1": FINE}, MISSION) as (browser, _, _):
        told = await posted(browser, "/stop", {"order": "hold", "robots": None})
        assert told["outcomes"] == {
            "uav1": ["confirmed", ""],
            "uav9": ["NOT confirmed", "its bridge is not on the bus"],
        }


async def test_a_board_that_publishes_a_mission_without_a_robot_takes_it_from_no_order(endpoint: str) -> None:
    async with commanded(endpoint, {"uav1": FINE}, MISSION) as (browser, _, _):
        forged = RunningMission(file="m.yaml", text="mission: sar\nagents: {c: {program: c.asl}}\n")
        browser.following.model.mission_published(keys.mission("sar", "pi3"), forged)
        told = await posted(browser, "/stop", {"order": "rtl", "robots": None})
        assert told["state"] == "NOT confirmed"
        assert told["outcomes"] == {
            "uav1": ["confirmed", ""],
            "uav9": ["NOT confirmed", "its bridge is not on the bus"],
        }


async def test_without_a_router_nobody_was_told_and_without_a_robot_an_order_to_all_says_so(endpoint: str) -> None:
    async with entered(Where("sar", endpoint)) as browser:
        told = await posted(browser, "/stop", {"order": "hold", "robots": None})
        assert told["problem"] == "the router is not reached: the order was not sent"
        assert "outcomes" not in told
        answer = await posted(browser, "/control", {"agent": "scout", "do": "pause"})
        assert answer == {"ok": False, "reason": "the router is not reached: the order was not sent"}
        assert (await posted(browser, "/why", {"agent": "scout"}))["error"] == "the router is not reached"
        async with router(endpoint):
            await until(lambda: browser.following.link.up, "the server is linked")
            assert (await posted(browser, "/stop", {"order": "land"}))["problem"] == "no robot is on the bus"


async def test_an_observer_sees_and_orders_nothing(endpoint: str) -> None:
    why = "`eye` is an observer in the mission: it may not give orders"
    async with commanded(endpoint, {"uav1": FINE}, MISSION, identity="eye") as (browser, [uav1], scout):
        async with browser.feed() as feed:
            await feed.until("head", observer=why, identity="eye")
            await feed.until("robot/uav1", standing="up")
        assert (await posted(browser, "/stop", {"order": "hold"}))["problem"] == why
        assert await posted(browser, "/control", {"agent": "scout", "do": "pause"}) == {"ok": False, "reason": why}
        assert (uav1.orders, scout.ordered) == ([], [])


@pytest.mark.parametrize("inject", [True, False])
async def test_minds_take_orders_and_refuse_them_in_words(endpoint: str, inject: bool) -> None:
    async with commanded(endpoint, {}, inject=inject) as (browser, _, scout):
        told = await posted(browser, "/control", {"agent": "scout", "do": "goal", "text": " go(3,4) "})
        if inject:
            assert told == {"ok": True}
            assert [(one.do, one.text) for one in scout.ordered] == [("goal", "go(3,4)")]
        else:
            assert told == {"ok": False, "reason": "the mission does not say `inject: true`"}


NO_NAMES = ("*", "**", "uav1/stop", "", "a?b", "$*")
REFUSED: list[tuple[str, dict[str, object], str]] = [
    ("/control", {"agent": "scout", "do": "goal", "text": "  "}, "expected a goal, such as `go(3,4)`"),
    ("/control", {"agent": "scout", "do": "belief", "text": "x" * 4_001}, "4001 characters, expected at most 4000"),
    ("/control", {"agent": "ghost", "do": "pause"}, "`ghost` did not answer: is it running?"),
    ("/why", {"agent": "scout", "about": "(("}, "expected the name of a goal"),
    *(("/stop", {"order": "rtl", "robots": [name]}, f"`{name}` is no name of a robot") for name in NO_NAMES),
    *(("/control", {"agent": name, "do": "pause"}, f"`{name}` is no name of an agent") for name in NO_NAMES),
    *(("/why", {"agent": name}, f"`{name}` is no name of an agent") for name in NO_NAMES),
]


async def test_what_no_robot_and_no_mind_can_take_is_refused_and_reaches_nobody(endpoint: str) -> None:
    async with commanded(endpoint, {"uav1": FINE, "uav2": FINE}) as (browser, robots, scout):
        for path, wish, why in REFUSED:
            told = await posted(browser, path, wish)
            assert why in str(told.get("problem") or told.get("error") or told.get("reason")), wish
            assert not told.get("ok")
        assert (await posted(browser, "/why", {"agent": "scout"}))["explanation"], "a right question has its answer"
        assert [one.orders for one in robots] == [[], []]
        assert scout.ordered == []


async def test_an_order_that_comes_late_or_from_a_clock_that_is_not_ours_is_refused_in_words(endpoint: str) -> None:
    async with commanded(endpoint, {"uav1": FINE}) as (browser, [uav1], scout):
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


async def test_an_order_cut_off_is_not_waited_for_by_its_pages(endpoint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    async def fails(_bus: Bus, _fleet: str) -> list[tuple[str, str]]:
        raise OSError("the session went")

    async with commanded(endpoint, {"uav1": None}) as (browser, _, _):
        monkeypatch.setattr(argosy.ui.page_requests, "bridges", fails)
        assert (await browser.post("/stop", {"order": "hold"}))[0] == 500
        [view] = browser.following.requests.last
        assert view.state == "NOT confirmed"
        assert view.outcomes == {"uav1": ("NOT confirmed", "interrupted: NOT known whether it was carried out")}
