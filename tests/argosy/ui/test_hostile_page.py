"""The page in a real browser, of a fleet that says script and markup wherever it can: nothing runs, all is text."""

import asyncio
import json
from argparse import Namespace

import pytest

from argosy.cli.operator_bus import Where, where
from tests.argosy.ui.browsing import Seen, browsing
from tests.argosy.ui.serving import served
from tests.argosy.watch.hostile import FLEET, MARKUP, saying
from tests.support.secured import Secured

pytestmark = pytest.mark.usefixtures("browser")

MISSION = """
mission: three
security: {operators: [ops]}
boards: BOARDS
agents:
  __proto__: {board: pi1, program: nothing.asl, robot: constructor}
  toString: {board: pi2, program: says.asl, robot: hasOwnProperty}
  valueOf: {board: pi3, program: nothing.asl, robot: length}
robots:
  constructor: {board: pi1, manifest: turtle, prefix: r1}
  hasOwnProperty: {board: pi2, manifest: turtle, prefix: r2}
  length: {board: pi3, manifest: turtle, prefix: r3}
"""
PROGRAM = """
believed(BAD).
!say.
+!say <-
    .print(BAD);
    .send(valueOf, tell, said(BAD));
    .send(nobody, tell, BAD);
    !wait(BAD).
+!wait(X) <- .wait(1000); .print(X); !wait(X).
"""
TABS = ("mind", "timeline", "mail", "why", "act")
MADE = (
    "img:not([src^='/static/']), iframe, object, embed, b.evil, a[href^='javascript:'], [onerror], [onload], [onclick]"
)


def test_nothing_that_a_fleet_says_runs_in_the_page_or_becomes_markup(endpoint: str) -> None:

    async def body() -> None:
        async with served(Where(FLEET, endpoint)) as server, browsing(server.auth.url) as seen:
            answer = await seen.page.request.get(server.base)
            policy = answer.headers["content-security-policy"]
            assert "default-src 'self'" in policy
            assert "unsafe" not in policy
            assert "require-trusted-types-for 'script'" in policy
            await _look_into(seen, "scout")
            await _nothing_ran(seen)

    with saying(endpoint, "markup"):
        asyncio.run(asyncio.wait_for(body(), 240))


def test_nothing_that_a_secured_fleet_says_runs_in_the_operators_page() -> None:
    """Agents and robots have the worst names that a mission may give: those of properties of JavaScript objects."""

    async def body(fleet: Secured) -> None:
        place = where(Namespace(mission=str(fleet.path), fleet=None, router=None, keys=fleet.keys("ops")))
        async with served(place, fleet.mission, identity="ops") as server, browsing(server.auth.url) as seen:
            await _look_into(seen, "__proto__")
            await seen.shows(".row[data-agent=__proto__][data-robot=constructor]")
            await _look_into(seen, "toString", "mind", "timeline")
            await seen.shows(".row[data-agent=valueOf]")
            await _nothing_ran(seen)

    with Secured(MISSION) as fleet:
        (fleet.folder / "says.asl").write_text(PROGRAM.replace("BAD", json.dumps(MARKUP)))
        fleet.routers()
        fleet.start("pi2", "agentd").says("agents=")
        names = (fleet.mission.fleet, "__proto__", "constructor")
        with saying(fleet.socket("pi1"), "markup", *names):
            asyncio.run(asyncio.wait_for(body(fleet), 240))


async def _look_into(seen: Seen, agent: str, *telling: str) -> None:
    """Look into an agent by every tab; those named, or mind, timeline and mail, come to show markup as text."""
    await seen.shows(f".row[data-agent={agent}]")
    await seen.page.click(f".row[data-agent={agent}]")
    for tab in TABS:
        await seen.page.click(f"#tab-{tab}")
        async with asyncio.timeout(240):
            while tab in (telling or TABS[:3]) and "<img src=x" not in await seen.says("body"):
                await seen.page.wait_for_timeout(100)
        await seen.page.wait_for_timeout(1_000)
        assert await seen.page.locator(MADE).count() == 0, tab
        assert await seen.page.locator("script:not([src])").count() == 0, tab


async def _nothing_ran(seen: Seen) -> None:
    assert await seen.page.evaluate("window.hacked") is None
    assert await seen.page.evaluate("Object.keys(Object.prototype).length") == 0
    assert "hacked" not in await seen.page.title()
    assert seen.hosts == {"127.0.0.1"}
    assert not seen.errors
