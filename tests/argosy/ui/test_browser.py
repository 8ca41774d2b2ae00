"""The page of `argosy ui` in a real browser, of a small fleet that really flies: map, mind, why, mail, stop."""

import re
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from argosy.cli.operator_bus import Where
from schemas.wire.records import Outcome
from tests.argosy.ui.browsing import APART, Seen, browsing
from tests.argosy.ui.fleets import Robot, fleet, router
from tests.argosy.ui.serving import served
from tests.support.processes import Daemon, running

pytestmark = pytest.mark.usefixtures("browser")

SCOUT = """\
home(-27.604033, -48.518363).
!patrol.
+!patrol <- set_mode("GUIDED"); arm_motors(true); takeoff(6); !visit(1).
@never +!visit(N) : too_far(N) <- .print("never").
@always +!visit(N) : home(Lat, Lon)
  <- .print("visit ", N); .send(helper, tell, visited(N)); goto(Lat + 0.0002, Lon, 6); goto(Lat, Lon + 0.0002, 6);
     !visit(N + 1).
-!visit(N) <- .wait(1000); !visit(N).
-!patrol <- .wait(1000); !patrol.
+wind(How) <- .print("the wind is ", How).
"""
HELPER = """\
+visited(N)[source(S)] <- .send(S, tell, seen(N)); .send(ghost, tell, hello(N)).
"""
MISSION = """\
mission: patrol
agents:
  scout: {program: scout.asl, robot: uav1}
  helper: {program: helper.asl}
clients: {ghost: {}}                                  # who never comes
mail: {ttl: 2s}
robots:
  uav1:
    manifest: copter
    link: udpin:127.0.0.1:PORT
    limits: {altitude: 30, radius: 100}
    simulate: {vehicle: copter, home: [-27.604033, -48.518363, 21.0]}
timeout: 60min
speed: 8
inject: true
"""


@pytest.fixture
def patrol(tmp_path: Path, endpoint: str, free_port: Callable[[], int]) -> Iterator[tuple[Daemon, str]]:
    """Fly the mission and serve its page; gives the server and the address of its page."""
    (tmp_path / "scout.asl").write_text(SCOUT)
    (tmp_path / "helper.asl").write_text(HELPER)
    mission = tmp_path / "patrol.yaml"
    mission.write_text(MISSION.replace("PORT", str(free_port())))
    with (
        running("argosy", "run", "--plain", str(mission), "--router", endpoint) as flight,
        running("argosy", "ui", "--mission", str(mission), "--router", endpoint, "--port", "0") as ui,
    ):
        ui.says("open http://")
        found = re.search(r"^open (\S+)$", ui.text, re.M)
        assert found
        try:
            yield ui, found[1]
        finally:
            flight.signal(signal.SIGINT)
            flight.ends()


async def test_the_page_shows_a_flight_tells_why_and_stops_it(patrol: tuple[Daemon, str]) -> None:
    ui, url = patrol
    async with browsing(url) as seen:
        assert "token" not in seen.page.url
        await _list_and_map(seen)
        await _mind(seen)
        await _why(seen)
        await _timeline_and_mail(seen)
        await _orders_to_a_mind(seen)
        await _stop(seen)
        assert seen.hosts == {"127.0.0.1"}, "nothing was asked of another machine"
        assert seen.errors == []
        ui.signal(signal.SIGTERM)
        await seen.shows(".banner.bad", "argosy ui does not answer")
        await seen.shows("body[data-old]")


async def _list_and_map(seen: Seen) -> None:
    await seen.shows("#router", "● router")
    await seen.shows(".row[data-agent=scout]", "uav1")
    await seen.shows(".row[data-agent=helper]", "idle")
    await seen.shows(".row[data-agent=scout]", "GUIDED armed")
    await seen.shows(".vessel.armed .label", "uav1")
    await seen.shows("#map .scale", "grid")
    await seen.shows(".mark.target")
    await seen.page.fill("#search", "helper")
    await seen.gone(".row[data-agent=scout]")
    await seen.page.fill("#search", "")
    await seen.page.click(".row[data-agent=scout]")
    await seen.shows(".row[data-agent=scout][aria-selected=true]")
    await seen.shows("#panel h2", "scout")


async def _mind(seen: Seen) -> None:
    await seen.page.click("#tab-mind")
    await seen.shows("#pane-mind", "visit(")
    await seen.shows("#pane-mind", "home(-27.604033,-48.518363)")
    await seen.page.click(".row[data-agent=helper]")
    await seen.shows("#pane-mind", "visited(1)")
    await seen.page.click(".row[data-agent=scout]")


async def _why(seen: Seen) -> None:
    await seen.page.click("#tab-why")
    await seen.shows("#pane-why", "visit")
    await seen.page.fill("#pane-why input", "visit")
    await seen.page.press("#pane-why input", "Enter")
    await seen.shows("#pane-why", "too_far(")


async def _timeline_and_mail(seen: Seen) -> None:
    await seen.page.click("#tab-timeline")
    await seen.shows(".event.is-print", "visit 1")
    await seen.shows(".event.of-outcome", "takeoff(6) succeeded")
    await seen.page.click(".toggle[data-kind=prints]")
    await seen.gone(".event.is-print")
    await seen.page.click(".toggle[data-kind=prints]")
    await seen.page.click("#tab-mail")
    await seen.shows(".lifeline", "helper")
    await seen.shows(".message.arrow", "tell visited(1)")
    await seen.shows(".message.flight", "tell hello(")
    await seen.shows(".message.lost", "tell hello(")
    await seen.page.locator(".message.lost").first.click()
    await seen.shows("#mail .detail", "helper → ghost")


async def _orders_to_a_mind(seen: Seen) -> None:
    await seen.page.click("#tab-act")
    await seen.page.fill("#act-belief", "wind(strong)")
    await seen.page.click("button[type=submit][data-do=belief]")
    await seen.shows(".acts .good", "belief wind(strong): done")
    await seen.page.click("#tab-timeline")
    await seen.shows(".event.is-print", "the wind is strong")
    await seen.page.fill("#act-goal", "visit((")
    await seen.page.click("button[type=submit][data-do=goal]")
    await seen.shows(".acts .bad", "NOT done")
    await seen.page.click("#tab-act")
    await seen.page.click("button[data-do=pause]")
    await seen.shows(".row[data-agent=scout] .state", "paused")
    await seen.page.click("button[data-do=resume]:not([aria-disabled=true])")
    await seen.gone(".row[data-agent=scout] .state.warn")


async def _stop(seen: Seen) -> None:
    hold = seen.page.locator("#panel [data-order=hold][data-robot=uav1]")
    await hold.click()
    await seen.shows("#panel [data-order=hold][data-state=armed]", "sure?")
    await seen.gone("#panel [data-order=hold][data-state=armed]")  # whoever thinks twice has ordered nothing
    assert await seen.page.locator(".outcome").count() == 0
    await seen.twice(hold)
    await seen.shows(".outcome.good", "uav1: hold confirmed")
    await seen.shows(".row[data-agent=scout]", "OPERATOR: hold")
    release = await seen.page.locator("header [data-order=release]").bounding_box()
    await seen.page.mouse.move(release["x"] + 5, release["y"] + 5)
    await seen.page.mouse.down()  # until it is done: one long press
    await seen.shows(".outcome.good", "release all: confirmed by it")
    await seen.page.mouse.up()


async def test_a_hold_that_was_not_confirmed_stays_on_the_page_and_a_lost_router_ages_all(endpoint: str) -> None:
    async with served(Where("sar", endpoint)) as browser, browsing(browser.auth.url) as seen:
        await seen.shows(".banner.bad", "no router at")
        answers = {"uav1": Outcome(ok=False, reason="the vehicle stays in AUTO")}
        async with fleet(endpoint, answers) as ([uav1], _):
            await seen.shows(".row[data-robot=uav1]")
            await seen.gone(".banner")
            uav1.tell()
            await seen.page.focus("header [data-order=hold]")
            await seen.page.keyboard.press("Enter")
            await seen.page.wait_for_timeout(APART)
            await seen.page.keyboard.press("Enter")
            await seen.shows(".outcome.bad", "uav1: hold NOT confirmed (the vehicle stays in AUTO)")
            assert uav1.orders == ["hold"]
        await seen.shows(".banner.bad", "is lost for")
        await seen.shows("body[data-old]")
        await seen.shows(".outcome.bad")
        await seen.page.click(".outcome .close")
        await seen.gone(".outcome.bad")
        async with router(endpoint):
            await seen.shows("#router", "● router")
            await seen.shows(".banner.warn", "No daemon of fleet sar is on the bus")
        assert seen.hosts == {"127.0.0.1"}


async def test_an_agent_whose_robot_comes_later_gets_its_orders(endpoint: str) -> None:
    async with (
        fleet(endpoint, {}) as (_, [scout]),
        served(Where("sar", endpoint)) as browser,
        browsing(browser.auth.url) as seen,
    ):
        await seen.shows(".row[data-agent=scout]")
        assert await seen.page.locator(".row [data-order=hold]").count() == 0
        uav1 = Robot(scout.bus, "uav1", "scout", Outcome(ok=True))
        uav1.healthy()
        await seen.shows(".row[data-agent=scout][data-robot=uav1]")
        await seen.twice(seen.page.locator(".row[data-robot=uav1] [data-order=hold]"))
        await seen.shows(".outcome.good", "uav1: hold confirmed")
        assert uav1.orders == ["hold"]


async def test_an_observer_is_told_why_the_buttons_do_nothing(endpoint: str, tmp_path: Path) -> None:
    from schemas.mission.model import load_mission

    (tmp_path / "m.yaml").write_text(
        "mission: sar\nagents: {scout: {program: s.asl, robot: uav1}}\nrobots: {uav1: {manifest: turtle}}\n"
        "security: {observers: [eye]}\n"
    )
    mission = load_mission(tmp_path / "m.yaml")
    async with (
        fleet(endpoint, {"uav1": Outcome(ok=True)}) as ([uav1], _),
        served(Where("sar", endpoint), mission, identity="eye") as browser,
        browsing(browser.auth.url) as seen,
    ):
        await seen.shows(".row[data-agent=scout]", "waiting")
        await seen.shows("header [data-order=rtl][aria-disabled=true]")
        await seen.page.locator("header [data-order=rtl]").click(force=True)
        await seen.shows(".outcome.bad", "`eye` is an observer in the mission: it may not give orders")
        await seen.page.click("#tab-act")
        await seen.shows("#pane-act .hint", "Not allowed: `eye` is an observer")
        assert uav1.orders == []
        assert seen.errors == []
