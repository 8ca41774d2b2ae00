"""What a page hears of a fleet on a real bus: its members, what they do, and when the router is gone."""

import asyncio
import json
from contextlib import AsyncExitStack

import aiohttp
import pytest

from argosy.cli.operator_bus import ANY, Where
from commd.bus.bus import Query
from schemas.wire.mind_records import MindView
from schemas.wire.records import Outcome
from tests.argosy.fleet_model.fleet import Fleet
from tests.argosy.ui.fleets import HOME, Agent, fleet, router
from tests.argosy.ui.serving import entered, served
from tests.support.buses import session, subscribed, until

FINE = Outcome(ok=True)


async def test_a_page_sees_robots_agents_minds_and_what_happens(endpoint: str) -> None:
    async with (
        fleet(endpoint, {"uav1": FINE}) as ([uav1], [scout]),
        entered(Where("sar", endpoint)) as browser,
        browser.feed("scout") as feed,
    ):
        await feed.until("head", router="up", fleet="sar")
        await feed.until("agent/scout", standing="up")
        await subscribed(uav1.bus, f"argosy/sar/{uav1.agent}/percepts")
        uav1.tell()
        await feed.until("robot/uav1", standing="up", agents=["scout"])
        uav1.tell(-27.6035, -48.5182)
        await feed.until("robot/uav1", mode="GUIDED", armed=True, position=[-27.6035, -48.5182], heading=90)
        assert feed.parts["robot/uav1"]["home"] == list(HOME)
        mind = await feed.until("mind/scout")
        assert mind["mind"]["intentions"][0]["stack"] == ["+!lane(2)", "+!search"]
        assert feed.parts["agent/scout"]["robot"] == "uav1"
        uav1.action(1, "goto", "running", -27.603, -48.518, 20)
        await feed.until("marks")
        await feed.hear_until(lambda: "marks" in feed.parts["marks"])
        assert feed.parts["marks"]["marks"][0]["kind"] == "target"
        scout.activity(kind="sent", id="m1", other="rescuer", performative="tell", text="victim(7)", time=3.0)
        scout.activity(kind="undelivered", id="m1", other="rescuer", reason="receiver_not_found", time=3.0)
        await feed.hear_until(lambda: any(one["what"] == "undelivered" for one in feed.events))
        messages = [part for key, part in feed.parts.items() if key.startswith("message/")]
        assert [(one["content"], one["undelivered"]) for one in messages] == [("victim(7)", "receiver_not_found")]


async def test_of_several_fleets_the_page_chooses_one(endpoint: str) -> None:
    async with router(endpoint), AsyncExitStack() as stack:
        bus = await stack.enter_async_context(session(endpoint, "x"))
        bus.token("argosy/north/scout/alive/agentd/b")
        bus.token("argosy/south/scout/alive/agentd/b")
        browser = await stack.enter_async_context(served(Where(ANY, endpoint)))
        await browser.enter()
        feed = await stack.enter_async_context(browser.feed())
        await feed.until("head", fleets=["north", "south"])
        assert (await browser.post("/fleet", {"fleet": "west"}))[1] == '{"ok":false}'
        assert (await browser.post("/fleet", {"fleet": "south"}))[1] == '{"ok":true}'
        await feed.until("head", fleet="south")
        await feed.until("agent/scout", standing="coming")
        assert (await browser.post("/fleet", {"fleet": "north"}))[1] == '{"ok":false}', "one for each run"


@pytest.mark.parametrize("text", ["", "[]", '{"look": 3}', '{"look": [1]}', '{"do": "rtl"}', "x" * 9_000])
async def test_a_page_that_says_something_else_is_closed(text: str) -> None:
    async with entered() as browser:
        socket = await browser.session.ws_connect(f"{browser.base}/feed", origin=browser.base)
        await socket.send_str(text)
        async with asyncio.timeout(120):
            while (await socket.receive()).type not in (aiohttp.WSMsgType.CLOSED, aiohttp.WSMsgType.CLOSE):
                pass
        assert socket.close_code in (1008, 1009)
        await until(lambda: not browser.following.pages, "the page is forgotten")


async def test_a_page_hears_each_second_that_we_are_there() -> None:
    async with entered() as browser, browser.feed() as feed:
        first = await feed.hear()
        told = await feed.hear()
        assert told.keys() == {"now"}
        assert told["now"] > first["now"]


async def test_a_page_that_takes_nothing_costs_no_memory_and_gets_the_newest_when_it_goes_on() -> None:
    async with entered() as browser:
        following = browser.following
        reader, writer = await asyncio.open_connection("127.0.0.1", browser.auth.port, limit=1_024)
        upgrade = (
            f"GET /feed HTTP/1.1\r\nHost: 127.0.0.1:{browser.auth.port}\r\nOrigin: {browser.base}\r\n"
            f"Cookie: {browser.auth.cookie}={browser.auth.token}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
            "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: MDEyMzQ1Njc4OTAxMjM0NQ==\r\n\r\n"
        )
        writer.write(upgrade.encode())
        await reader.readuntil(b"\r\n\r\n")
        await until(lambda: len(following.pages) == 1, "the page is there")
        page = next(iter(following.pages))
        big = {f"x{one}": "y" * 10_000 for one in range(100)}
        following.refresh = lambda: None  # type: ignore[method-assign]
        page._refresh = lambda: following.shown.show({"big": big | {"turn": following.shown.turn}})
        await until(lambda: page.sent > 1_000_000, "it is told much")
        before = -1
        while page.sent != before:  # until it takes no more
            before = page.sent
            await asyncio.sleep(1.0)
        assert page.sent < 12_000_000, "what waits is what the sockets hold, and one message"
        turn = following.shown.turn
        following.shown.show({"big": {"turn": "newest"}})
        page._refresh = lambda: None
        tail = b""
        async with asyncio.timeout(120):
            while b'"newest"' not in tail:
                tail = tail[-20:] + await reader.read(1_000_000)
        assert following.shown.turn >= turn
        writer.close()


async def test_whoever_comes_back_gets_no_event_twice() -> None:
    async with entered() as browser:
        for number in range(5):
            browser.following.model.timeline.add(1.0, "scout", "print", f"line {number}")
        async with browser.feed() as feed:
            await feed.hear_until(lambda: feed.events)
        newest = feed.events[-1]["number"]
        browser.following.model.timeline.add(1.0, "scout", "print", "line 5")
        async with browser.feed(event=newest) as again:
            await again.hear_until(lambda: again.events)
        assert [one["text"] for one in again.events] == ["line 5"]
        assert json.dumps(feed.events[0])


async def test_of_fifty_agents_a_page_is_told_what_changed_and_nothing_else() -> None:
    async with entered() as browser:
        following = browser.following
        paper = Fleet()
        following.model = paper.model
        for number in range(50):
            paper.comes(f"uav{number}", "bridged").comes(f"agent{number}", "agentd")
            paper.told(f"uav{number}", "bridged", percepts={f"agent{number}": "b:1:0"})
            paper.mind(f"agent{number}", "+!visit(3)").percept(f"agent{number}", "state", "GUIDED", True, True)
            paper.percept(f"agent{number}", "global_pos", -27.6, -48.5 + number / 1000)
        async with browser.feed("agent7") as feed:
            await feed.until("robot/uav49", mode="GUIDED")
            assert feed.sizes[0] < 100_000
            assert len([key for key in feed.parts if key.startswith("agent/")]) == 50
            while (await feed.hear()).keys() != {"now"}:
                pass
            paper.percept("agent7", "global_pos", -27.7, -48.5).waits(1.0)
            told = await feed.hear()
            assert list(told["set"]) == ["robot/uav7"]
            assert feed.sizes[-1] < 1_000


async def test_whom_a_page_has_looked_at_is_not_looked_at_any_more_when_it_has_closed(endpoint: str) -> None:
    asked: list[str] = []

    class Curious(Agent):
        async def _mind(self, query: Query[MindView]) -> None:
            asked.append(query.parameters.get("last", "20"))
            await super()._mind(query)

    async with router(endpoint), session(endpoint, "scout") as bus, served(Where("sar", endpoint)) as browser:
        Curious(bus, "scout")
        await browser.enter()
        async with browser.feed("scout") as feed:
            await feed.until("mind/scout")
            assert browser.following._looked == {"scout"}
        await until(lambda: not browser.following.pages, "the page is closed")
        assert browser.following._looked == frozenset()
        watcher = browser.following.link._observer
        assert watcher is not None
        del asked[:]
        await until(lambda: len(asked) >= 2, "it is asked still")
        assert set(asked[1:]) == {"0"}, "for the list and the map, and not for a panel that nobody sees"
