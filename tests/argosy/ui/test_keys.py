"""The page of a fleet with keys: an operator orders at each board, an observer sees the same and orders nothing."""

import json
import time
from argparse import Namespace
from collections.abc import AsyncIterator, Iterator
from contextlib import AsyncExitStack, asynccontextmanager

import pytest

from argosy.cli.operator_bus import where
from commd.bus.bus import open_bus
from commd.bus.tls import identity_of
from schemas.wire.records import Outcome
from tests.argosy.ui.fleets import Robot
from tests.argosy.ui.serving import Browser, Feed, served
from tests.support.secured import Secured


@pytest.fixture
def boards() -> Iterator[Secured]:
    """Two boards of three, with keys; the third is not there."""
    with Secured() as made:
        made.routers(("pi1", "pi2"))
        yield made


@asynccontextmanager
async def page_of(made: Secured, who: str) -> AsyncIterator[tuple[Browser, Feed, Robot]]:
    """The page of somebody with keys, and a robot that confirms whatever it is told."""
    place = where(Namespace(mission=str(made.path), fleet=None, router=None, keys=made.keys(who)))
    assert place.tls is not None
    async with AsyncExitStack() as stack:
        opened = open_bus(made.socket("pi1"), fleet="three", name="r1", daemon="bridged")
        robot = Robot(await stack.enter_async_context(opened), "r1", "a", Outcome(ok=True), fleet="three")
        identity = identity_of(place.tls, time.time()).name
        browser = await stack.enter_async_context(served(place, made.mission, identity=identity))
        await browser.enter()
        feed = await stack.enter_async_context(browser.feed())
        await feed.until("head", router="up", identity=who)
        await feed.until("robot/r1", standing="coming")
        yield browser, feed, robot


async def test_an_operator_orders_and_is_told_of_boards_that_are_not_reached(boards: Secured) -> None:
    async with page_of(boards, "ops") as (browser, feed, robot):
        _, text = await browser.post("/stop", {"order": "hold", "robots": None})
        outcomes = json.loads(text)["outcomes"]
        assert outcomes["r1"] == ["confirmed", ""]
        assert outcomes["r2"] == ["NOT confirmed", "its bridge is not on the bus"]
        assert outcomes["r3"][0] == "NOT confirmed"
        assert "board pi3 is not reached" in outcomes["r3"][1]
        assert robot.orders == ["hold"]
        await feed.hear_until(lambda: any("pi3" in line for line in feed.parts["head"].get("unreached", ())))


async def test_an_observer_sees_robots_and_the_server_says_why_it_orders_nothing(boards: Secured) -> None:
    async with page_of(boards, "eye") as (browser, feed, robot):
        why = "`eye` is an observer in the mission: it may not give orders"
        assert feed.parts["head"]["observer"] == why
        _, text = await browser.post("/stop", {"order": "hold", "robots": None})
        assert json.loads(text)["problem"] == why
        assert robot.orders == []
