"""What the page says when something is wrong: a server that hangs, members that are gone, hands that slip."""

import asyncio
import re
import signal
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

import pytest

import argosy.ui.page_requests
from argosy.cli.operator_bus import Where
from argosy.fleet_model.model import FleetModel
from argosy.fleet_model.timeline import MOST
from argosy.ui.map_markers import marks
from commd.bus.bus import Bus
from commd.daemon import publish_mission
from schemas.mission.model import read_mission
from schemas.wire import keys
from schemas.wire.records import Health, Note, Outcome, RunPhase, RunState
from schemas.wire.terms import Atom
from tests.argosy.ui.browsing import APART, PATIENCE, Seen, browsing
from tests.argosy.ui.fleets import Agent, Robot, fleet, router
from tests.argosy.ui.serving import Browser, entered, served
from tests.support.buses import session, until
from tests.support.processes import running

pytestmark = pytest.mark.usefixtures("browser")

FINE = Outcome(ok=True)


async def test_a_hanging_server_is_told_of_and_what_was_ordered_is_refused_when_it_goes_on(endpoint: str) -> None:
    async with AsyncExitStack() as stack:
        ([uav1], _) = await stack.enter_async_context(fleet(endpoint, {"uav1": FINE}))
        ui = stack.enter_context(running("argosy", "ui", "--fleet", "sar", "--router", endpoint, "--port", "0"))
        await asyncio.to_thread(ui.says, "open http://")
        url = re.search(r"^open (\S+)$", ui.text, re.M)
        seen = await stack.enter_async_context(browsing(url[1]))
        await seen.shows(".row[data-agent=scout]", "waiting")
        ui.signal(signal.SIGSTOP)
        try:
            await seen.shows(".banner.bad", "argosy ui does not answer")
            await seen.shows("body[data-old]")
            await seen.shows("#router", "? router")
            await seen.twice(seen.page.locator("header [data-order=hold]"))
            await seen.shows(".outcome.calm", "hold all: is being ordered")
            await seen.shows(".outcome.bad", "hold all: NOT known whether it was done")
            await seen.page.wait_for_timeout(5_000)  # as long as an order is one
        finally:
            ui.signal(signal.SIGCONT)
        await seen.shows(".outcome.bad", "NOT ordered: it came")
        await seen.gone(".banner.bad")
        await seen.twice(seen.page.locator("header [data-order=land]"))
        await seen.shows(".outcome.good", "land all: confirmed by it")
        assert uav1.orders == ["land"], "what was ordered while it hung was not done"


async def test_who_is_gone_is_shown_as_gone_everywhere(endpoint: str) -> None:
    async with router(endpoint), served(Where("sar", endpoint)) as browser, browsing(browser.auth.url) as seen:
        async with session(endpoint, "scout") as one, session(endpoint, "uav1") as other:
            scout, uav1 = Agent(one, "scout"), Robot(other, "uav1", "scout", FINE)
            telling = asyncio.create_task(_tells(scout, uav1))
            try:
                await seen.shows(".row[data-agent=scout]", "GUIDED armed")
            finally:
                telling.cancel()
        await seen.shows(".row.gone[data-agent=scout] .state.gone", "gone")
        await seen.shows(".row[data-agent=scout] .how.bad", "bridge gone")
        await seen.shows(".vessel.old .label")
        await seen.shows("#panel .title .state.gone", "gone")
        await seen.page.click("#tab-act")
        await seen.shows("#pane-act .hint", "Not allowed: scout is not there")


async def _tells(scout: Agent, uav1: Robot) -> None:
    while True:
        scout.bus.put(keys.health("sar", "scout", "agentd"), Health(daemon="agentd"))
        uav1.bus.put(keys.health("sar", "uav1", "bridged"), Health(daemon="bridged", percepts={"scout": "b:1:0"}))
        uav1.tell()
        await asyncio.sleep(0.5)


@asynccontextmanager
async def paged(endpoint: str, *robots: str) -> AsyncIterator[tuple[list[Robot], Browser, Seen]]:
    """Open the page of a fleet of robots that confirm whatever they are told."""
    async with (
        fleet(endpoint, dict.fromkeys(robots, FINE)) as (craft, _),
        served(Where("sar", endpoint)) as browser,
        browsing(browser.auth.url) as seen,
    ):
        for robot in robots:
            await seen.shows(f".row[data-robot={robot}]")
        yield craft, browser, seen


async def test_a_key_that_is_held_and_a_double_click_order_nothing(endpoint: str) -> None:
    async with paged(endpoint, "uav1") as ([uav1], _, seen):
        button = seen.page.locator("header [data-order=release]")
        await button.focus()
        for _ in range(40):
            await seen.page.keyboard.down("Enter")
            await seen.page.wait_for_timeout(33)
        await seen.page.keyboard.up("Enter")
        await seen.shows("header [data-order=release][data-state=armed]")
        await seen.gone("header [data-order=release][data-state=armed]")
        await button.dblclick(delay=20)
        await seen.shows("header [data-order=release][data-state=armed]")
        assert uav1.orders == []
        await seen.page.wait_for_timeout(APART)
        await button.click()
        await button.click()
        await button.click()
        await seen.shows(".outcome.good", "release all: confirmed by it")
        assert uav1.orders == ["release"], "one order, whatever was clicked after it"


async def test_a_robot_is_paused_and_continued_by_its_buttons_and_shown_as_paused_meanwhile(endpoint: str) -> None:
    async with paged(endpoint, "uav1") as ([uav1], _, seen):
        uav1.tell()
        await seen.shows(".row[data-robot=uav1] .how", "GUIDED")
        await seen.twice(seen.page.locator("header [data-order=pause]"))
        await seen.shows(".outcome.good", "pause all: confirmed by it")
        uav1.percept("paused", Atom("operator"))
        await seen.shows(".row[data-robot=uav1] .how.warn", "PAUSED GUIDED")
        await seen.twice(seen.page.locator("header [data-order=continue]"))
        await seen.shows(".outcome.good", "continue all: confirmed by it")
        uav1.gone("paused")
        await seen.gone(".row[data-robot=uav1] .how.warn")
        assert uav1.orders == ["pause", "continue"]


async def test_nothing_is_confirmed_with_nobody_known_to_order(endpoint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    known = asyncio.Event()

    async def nobody(_bus: Bus, _fleet: str) -> list[tuple[str, str]]:
        await known.wait()
        return []

    monkeypatch.setattr(argosy.ui.page_requests, "bridges", nobody)
    async with router(endpoint), served(Where("sar", endpoint)) as browser, browsing(browser.auth.url) as seen:
        await seen.shows("#router", "● router")
        await seen.twice(seen.page.locator("header [data-order=hold]"))
        await seen.shows(".outcome.calm", "hold all: looking for robots")
        assert browser.following.requests.last[-1].state == "looking"
        known.set()
        await seen.shows(".outcome.bad", "hold all: NOT ordered: no robot is on the bus")


async def test_the_newest_order_is_on_top_and_many_robots_alike_are_one_line(endpoint: str) -> None:
    async with paged(endpoint, *(f"uav{number}" for number in range(6))) as (craft, _, seen):
        for robot in craft:
            robot.answer = Outcome(ok=False, reason="it hangs")
        await seen.twice(seen.page.locator("header [data-order=hold]"))
        await seen.shows(".outcome.bad li", "6 robots: hold NOT confirmed (it hangs)")
        await seen.shows(".outcome.bad li details p", "uav0 uav1 uav2 uav3 uav4 uav5")
        for robot in craft[:5]:
            robot.answer = FINE
        await seen.twice(seen.page.locator("header [data-order=land]"))
        await seen.shows(".outcome.bad b", "land all: 1 of 6 NOT confirmed")
        told = await seen.page.locator(".outcome").all_inner_texts()
        assert [bool(re.search("land all", one)) for one in told] == [True, False]
        assert told[0].index("uav5: land NOT confirmed (it hangs)") < told[0].index("5 robots: land confirmed")


@pytest.mark.parametrize("width", [720, 768, 900, 1024, 1280])
async def test_the_stop_buttons_are_in_the_window_whatever_else_there_is_to_say(width: int) -> None:
    async with (
        served(Where("search-and-rescue-number-2", "tcp/127.0.0.1:9")) as browser,
        browsing(browser.auth.url, width=width) as seen,
    ):
        await seen.shows("#router", "not reached")
        await seen.page.evaluate("""() => {
            document.querySelector('.time').hidden = document.querySelector('.done').hidden = false;
            document.querySelector('.time').textContent = '12:34 of 40 min ×0.46';
            document.querySelector('.done').textContent = '10 of 13 done';
        }""")
        for order in ("hold", "land", "rtl", "release", "pause", "continue"):
            box = await seen.page.locator(f"header [data-order={order}]").bounding_box()
            assert box["x"] >= 0
            assert box["x"] + box["width"] <= width
            assert box["width"] > 30


async def test_a_part_that_cannot_be_drawn_is_told_and_the_others_go_on(endpoint: str) -> None:
    async with paged(endpoint, "uav1") as ([uav1], _, seen):
        uav1.tell()
        await seen.shows(".vessel .label")
        await seen.page.evaluate("() => { window.L.Marker.prototype.setLatLng = () => { throw Error('no place') } }")
        await seen.shows(".banner.bad", "the map cannot be drawn: no place")
        await seen.twice(seen.page.locator("header [data-order=hold]"))
        await seen.shows(".outcome.good", "hold all: confirmed by it")


async def test_a_defect_of_the_server_is_a_banner_and_orders_go_on(
    endpoint: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    async with paged(endpoint, "uav1") as (_, browser, seen):

        def broken(_model: FleetModel) -> None:
            raise OverflowError("cannot convert float infinity to integer")

        monkeypatch.setattr("argosy.ui.fleet_session.marks", broken)
        await seen.shows(".banner.bad", "a defect of argosy ui: OverflowError: cannot convert float infinity")
        await seen.twice(seen.page.locator("header [data-order=hold]"))
        await seen.shows(".outcome.good", "hold all: confirmed by it")
        monkeypatch.setattr("argosy.ui.fleet_session.marks", marks)
        await seen.gone(".banner.bad")
        assert browser.following.pages
    assert capsys.readouterr().err.count("a defect of argosy ui") == 1


async def test_a_fresh_page_on_a_tablet_shows_the_newest_events_and_follows_them() -> None:
    async with served() as browser:
        timeline = browser.following.model.timeline
        for number in range(400):
            timeline.add(1.0 + number, "scout", "print", f"line {number} " + "x" * (number % 7 * 40))
        async with browsing(browser.auth.url, width=768, height=1024, touch=True) as seen:
            for number in range(400, 440):
                await seen.shows(".event", f"line {number - 1}")
                timeline.add(1.0 + number, "scout", "print", f"line {number} " + "x" * (number % 7 * 40))
            await seen.shows(".event", "line 439")
            await seen.page.wait_for_timeout(500)
            assert not await seen.page.locator(".newer").is_visible()
            below = "(one => one.scrollHeight - one.scrollTop - one.clientHeight)(document.querySelector(LIST))"
            below = below.replace("LIST", "'#timeline .scroll'")
            assert await seen.page.evaluate(below) < 24
            await seen.page.locator("#timeline .scroll").hover()
            await seen.page.mouse.wheel(0, -2_000)
            await seen.page.wait_for_function(f"{below} > 500", timeout=PATIENCE)
            timeline.add(900.0, "scout", "print", "the last one")
            await seen.shows(".newer", "1 newer")


async def test_events_that_a_page_missed_are_counted_on_it() -> None:
    async with served() as browser, browsing(browser.auth.url) as seen:
        add = browser.following.model.timeline.add
        add(1.0, "scout", "print", "the first")
        await seen.shows(".event", "the first")
        assert not await seen.page.locator(".missed").is_visible()
        for _ in range(MOST + 101):
            add(1.0, "scout", "print", "x")
        await seen.shows(".missed", "101 events did not come here")


async def test_a_page_for_which_there_is_no_room_says_so_and_comes_when_there_is() -> None:
    async with entered() as browser, AsyncExitStack() as stack:
        first = await browser.session.ws_connect(f"{browser.base}/feed", origin=browser.base)
        for _ in range(15):
            await stack.enter_async_context(browser.feed())
        await until(lambda: len(browser.following.pages) == 16, "16 pages are open")
        seen = await stack.enter_async_context(browsing(browser.auth.url))
        await seen.shows(".banner.bad", "argosy ui refuses this page: 16 pages are open already")
        await first.close()
        await seen.shows("#router", "router")
        await seen.gone(".banner:has-text('16 pages')")


@pytest.mark.parametrize("hash", ["#%", "#constructor/mind"])
async def test_an_address_that_somebody_has_written_by_hand_opens_the_page(hash: str) -> None:
    async with served() as browser, browsing(browser.auth.url + hash) as seen:
        await seen.shows("#router", "not reached")


async def test_a_robot_that_nobody_attends_is_an_alarm_on_its_card_before_every_other_note(endpoint: str) -> None:
    async with paged(endpoint, "uav1") as ([uav1], _, seen):
        alone = Note(code="robot_unattended", text="in the air with nobody in charge")
        uav1.notes = (Note("failsafe_none", "failsafe: none"), alone)
        await seen.shows(".row .notes.bad", "⚠ in the air with nobody in charge · failsafe: none")
        uav1.notes = ()
        await seen.gone(".row .notes.bad")


async def test_an_action_of_which_nobody_tells_is_not_shown_as_running_on(endpoint: str) -> None:
    async with paged(endpoint, "uav1") as ([uav1], _, seen):
        uav1.tell()
        await seen.shows(".row[data-robot=uav1]", "GUIDED")
        uav1.action(1, "goto", "running", -27.603, -48.518, 20)
        await seen.shows(".row .state", "flying: goto(-27.603,-48.518,20)")
        await seen.shows(".row .doing[data-silent]", "goto(-27.603,-48.518,20) for")
        await seen.shows(".row .doing[data-silent]", "not heard of for")


async def run_told(bus: Bus, phase: RunPhase, seconds: float, **fields: str) -> None:
    """Tell how far a run has come, as `argosy run` does."""
    bus.put(keys.run("sar", "operator"), RunState(phase=phase, mission_time=seconds, **fields))  # type: ignore[arg-type]


async def test_a_mission_that_is_done_is_shown_as_done_after_everybody_and_the_router_have_gone(endpoint: str) -> None:
    async with served(Where("sar", endpoint)) as browser, browsing(browser.auth.url) as seen:
        async with fleet(endpoint, {"uav1": FINE}) as ([uav1], [_]):
            await seen.shows(".row[data-robot=uav1]")  # the page listens: what follows is said once
            uav1.tell()
            await run_told(uav1.bus, "running", 61.0)
            await seen.shows("#run.good", "running")
            await seen.shows(".chip.time", "1:0")
            uav1.percept("state", "RTL", True, False)
            await seen.shows(".row[data-robot=uav1]", "RTL disarmed")
            await run_told(uav1.bus, "done", 123.4, report="/logs/one", recording="/logs/one.zip")
            await seen.shows(".banner.good", "The mission is done after 123.4 s.")
        await seen.shows("#router.calm", "router ended")
        await seen.page.wait_for_timeout(4_000)  # longer than what was known last may be old
        await seen.shows(".banner.good", "Report: /logs/one. Recording: /logs/one.zip.")
        await seen.shows("#run.good", "done")
        await seen.shows(".chip.time", "2:03")
        await seen.shows(".row[data-robot=uav1]", "RTL disarmed")
        for alarming in (".banner.warn", ".row.gone", ".row.stale", ".vessel.old", "[data-old]", ".bad"):
            assert await seen.page.locator(f"{alarming}:visible").count() == 0, alarming


async def test_a_mission_that_has_failed_says_why_and_who_has_died_is_gone(endpoint: str) -> None:
    async with (
        fleet(endpoint, {"uav1": FINE}) as ([uav1], [scout]),
        served(Where("sar", endpoint)) as browser,
        browsing(browser.auth.url) as seen,
    ):
        uav1.tell()
        await run_told(uav1.bus, "running", 61.0)
        await seen.shows("#run.good", "running")
        why = {"why": "agentd scout was killed", "dead": ("agentd scout",)}
        await run_told(uav1.bus, "bringing_home", 70.0, **why)  # type: ignore[arg-type]
        await seen.shows("#run.warn", "bringing home")
        await scout.bus.close()
        await seen.shows(".row.gone[data-agent=scout]", "gone")
        await run_told(uav1.bus, "failed", 80.0, **why)  # type: ignore[arg-type]
        await seen.shows(".banner.bad", "The mission has failed after 80.0 s: agentd scout was killed.")
        await seen.shows("#run.bad", "failed")


async def test_a_run_that_nobody_watches_over_is_told_of(endpoint: str) -> None:
    async with paged(endpoint, "uav1") as ([uav1], _, seen):
        await run_told(uav1.bus, "running", 61.0)
        await seen.shows(".banner.warn", "argosy run has not been heard for")


async def test_what_several_say_in_the_same_words_is_said_once_and_an_alarm_above_everything(endpoint: str) -> None:
    async with paged(endpoint, "uav1", "uav2") as (craft, _, seen):
        none = Note("failsafe_none", "failsafe: none")
        for robot in craft:
            robot.notes = (none,)
        craft[0].notes += (Note(code="robot_unattended", text="in the air, and its agent intends nothing"),)
        await seen.shows(".shared", "⚠ uav1, uav2: failsafe: none")
        await seen.shows(".banner.bad", "uav1: in the air, and its agent intends nothing")
        assert await seen.page.locator(".row", has_text="failsafe").count() == 0


async def test_the_page_shows_the_mission_that_runs_whatever_it_was_started_with(endpoint: str, tmp_path: Path) -> None:
    async with fleet(endpoint, {"uav1": FINE}), session(endpoint, "local") as board:
        text = "mission: {}\nfleet: sar\nagents: {{scout: {{program: a.asl}}{}}}\ntimeout: {}min\n"
        ours = read_mission(text.format("ours", "", 7), tmp_path / "ours.yaml")
        theirs = read_mission(text.format("theirs", ", ghost: {program: a.asl}", 3), tmp_path / "theirs.yaml")
        publish_mission(board, "local", ours)
        board.token(keys.alive("sar", "local", "commd", board.boot))
        async with served(Where("sar", endpoint), theirs) as browser, browsing(browser.auth.url) as seen:
            await seen.shows("header .mission", "ours")
            await seen.gone(".row[data-agent=ghost]")
            await seen.shows(".banner.warn", "The fleet runs another mission than theirs.yaml")
