"""The panel of a mind in a real browser: what an agent shows stands there, can be found, and leads to why."""

import json
from typing import Any

import msgspec
import pytest
from msgspec.structs import replace

from argosy.cli.operator_bus import Where
from schemas.wire.mind_records import ActivityEvent, DropView, IntentionView, MindView, WaitView
from tests.agentd.mind_format_page import PAGE
from tests.argosy.ui.browsing import Seen, browsing
from tests.argosy.ui.fleets import fleet
from tests.argosy.ui.serving import served
from tests.docs.pages import part_of

pytestmark = pytest.mark.usefixtures("browser")


def scout() -> MindView:
    """The mind of docs/reference/records.md, and what that has not."""
    told: Any = json.loads(part_of(PAGE, "example").removeprefix("```json\n").removesuffix("```\n"))
    mind = msgspec.convert(told, MindView)
    deep = IntentionView(
        id=7,
        state="waiting",
        waits_for=WaitView(kind="action", name="goto"),
        since=30.0,
        stack=("+!lane(2)", "+!search", "+!mission"),
        at="scout.asl:31",
    )
    return replace(
        mind,
        intentions=(*mind.intentions, deep),
        intentions_left_out=3,
        beliefs_left_out=120,
        actions=(
            ActivityEvent(kind="action", id="a:1", text="takeoff(5)", time=10.0),
            ActivityEvent(kind="outcome", id="a:1", state="succeeded", time=16.0),
            ActivityEvent(kind="action", id="a:2", text="goto(1,2,5)", time=30.0),
        ),
        drops=(DropView(what="events", name="+tick/1", count=40, first=1.0, last=41.0, reason="too many events"),),
        dropped={"events": 40},
    )


async def _panel(seen: Seen) -> None:
    await seen.page.click(".row[data-agent=scout]")
    await seen.page.click("#tab-mind")
    await seen.shows(".mind-state", "cycle 9 · paused · goes on by itself in 9")
    part = '[data-part="{}"]'.format
    await seen.shows(f"{part('intentions')} .intention", "#7 waiting for the action goto")
    stack = await seen.page.locator(
        f"{part('intentions')} .intention:has-text('#7') .goal .data.grow"
    ).all_inner_texts()
    assert stack == ["+!mission", "+!search", "+!lane(2)"], "a tree: what it is all for comes first"
    await seen.shows(f"{part('intentions')} > p", "3 more are not shown")
    await seen.shows(f"{part('intentions')} .place", "scout.asl:31")
    await seen.shows(f"{part('actions')} li[data-state=running]", "goto(1,2,5)")
    await seen.shows(f"{part('actions')} li[data-state=ended]", "takeoff(5)")
    await seen.shows(f"{part('events')} li", "+!report(2)")
    await seen.shows(f"{part('questions')} li", "ana: askOne victims(N)")
    await seen.shows(f"{part('dropped')} li", "40 events +tick/1: too many events")
    belief = seen.page.locator(f"{part('beliefs')} li", has_text="victim(30,40)")
    assert await belief.locator(".data.grow").inner_text() == "victim(30,40)", "the source stands beside it"
    assert await belief.locator(".source").inner_text() == "ana"
    await seen.shows(f"{part('beliefs')} > p", "120 more are not shown")
    decision = seen.page.locator(f"{part('decisions')} li", has_text="+!patrol").first
    await decision.locator("summary").click()
    await seen.shows(f"{part('decisions')} .rejected", "✕ @careful +!patrol: 12 > 20 does not hold")
    await seen.shows(f"{part('decisions')} .chosen", "✓ +!patrol")
    await seen.shows(f"{part('prints')} li", "ana has found somebody")


async def _plans(seen: Seen) -> None:
    plans = '[data-part="plans"]'
    await seen.page.click(f"{plans} > summary")
    await seen.shows(f"{plans} li", "@careful +!patrol : battery(B) & (B > 20)")
    await seen.page.click(f"{plans} li:has-text('careful') details > summary")
    await seen.shows(f"{plans} pre", "takeoff(5).")


async def _find(seen: Seen) -> None:
    await seen.page.fill(".mind-bar input", "victim")
    await seen.gone('[data-part="intentions"] .intention')
    assert await seen.page.locator('[data-part="beliefs"] li').count() == 1
    await seen.page.fill(".mind-bar input", "")
    await seen.shows('[data-part="intentions"] .intention', "#7")


async def _why(seen: Seen) -> None:
    goal = seen.page.locator('[data-part="intentions"] .goal', has_text="+!patrol")
    await goal.hover()
    await goal.locator(".ask").click()
    await seen.shows("#tab-why[aria-selected=true]")
    await seen.shows("#pane-why .card", "B > 20 does not hold, with B = 12")
    assert await seen.page.locator("#pane-why input").input_value() == "patrol"
    await seen.shows("#pane-why .place", "scout.asl:")
    await seen.page.fill("#pane-why input", "")
    await seen.page.press("#pane-why input", "Enter")
    await seen.shows("#pane-why .card[data-kind]")


async def test_the_panel_shows_a_mind_finds_in_it_and_tells_why(endpoint: str) -> None:
    async with fleet(endpoint, {}) as (_, (agent,)):
        agent.view = scout()
        async with served(Where("sar", endpoint)) as browser, browsing(browser.auth.url, 1400, 1000) as seen:
            await _panel(seen)
            await _plans(seen)
            await _find(seen)
            await _why(seen)
            assert seen.errors == []
            assert seen.hosts == {"127.0.0.1"}
