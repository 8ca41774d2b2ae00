"""The imperative scout and rescuer alone, with a team that only pretends: the book, and what a rescuer does next."""

from __future__ import annotations

import asyncio
from collections import defaultdict
from collections.abc import Callable, Coroutine
from typing import Any

import pytest

from benchmarks.imperative.rescuer import Rescuer
from benchmarks.imperative.scout import Scout
from commd.client import Unanswered
from schemas.wire.records import ActionStatus
from schemas.wire.terms import Structure, Term

AT_ONCE = 1000.0
"""Times the speed of the mission: five minutes pass in 0.3 s."""


class Pretended:
    """A team: what is sent is kept, questions are answered as told, actions do what they say, percepts are put."""

    def __init__(self, name: str, speed: float) -> None:
        self.name, self.speed = name, speed
        self.sent: list[tuple[str, str, Term]] = []
        self.did: list[str] = []
        self.away: set[str] = set()
        self.answers: dict[tuple[str, str], Any] = {}
        """What somebody answers to a question of a kind; nothing if it stands not here."""
        self.seen: dict[str, list[tuple[Any, ...]]] = defaultdict(list)
        self.seen["state"], self.seen["altitude"], self.seen["latch"] = [("STABILIZE", True, False)], [(0.0,)], [(0,)]
        self.seen["global_pos"] = self.seen["home_pos"] = [(-27.604, -48.518)]
        self.seen["battery"] = [(0, 12.0, 100)]

    def percepts(self) -> Pretended:
        return self

    def of(self, name: str) -> list[tuple[Any, ...]]:
        return self.seen[name]

    async def until(self, condition: Callable[[Any], bool], patience: float) -> bool:
        await asyncio.sleep(0 if condition(self) else patience)
        return condition(self)

    async def there(self, name: str) -> bool:
        return name not in self.away

    def wall(self, seconds: float) -> float:
        return seconds / self.speed

    async def sleep(self, seconds: float) -> None:
        await asyncio.sleep(seconds / self.speed)

    async def send(self, receiver: str, performative: str, content: Any) -> None:
        self.sent.append((receiver, performative, content))

    async def ask(self, receiver: str, content: Any, patience: float) -> Any:
        self.sent.append((receiver, "askOne", content))
        await asyncio.sleep(0)
        if (receiver, content.functor) not in self.answers:
            raise Unanswered
        return self.answers[receiver, content.functor]

    async def perform(self, action: str, *parameters: Any) -> ActionStatus:
        self.did.append(action)
        match action:
            case "set_mode":
                self.seen["state"] = [(parameters[0], True, self.seen["state"][0][2])]
            case "arm_motors":
                self.seen["state"] = [("GUIDED", True, True)]
            case "takeoff":
                self.seen["altitude"] = [parameters]
            case "goto":
                await asyncio.sleep(0.01)
                self.seen["global_pos"] = [parameters[:2]]
            case "drop_buoy" | "load_buoy":
                self.seen["latch"] = [(1900 if action == "drop_buoy" else 1100,)]
            case "return_to_launch":
                self.seen["state"], self.seen["altitude"] = [("RTL", True, False)], [(0.0,)]
                self.seen["global_pos"] = self.seen["home_pos"]
        return ActionStatus(id="1", state="succeeded", result=True, name=action)

    def told(self, *fact: Any) -> list[tuple[str, str]]:
        """Who was told something, and how."""
        return [(who, how) for who, how, what in self.sent if what == Structure(fact[0], fact[1:])]


def run(body: Coroutine[Any, Any, None]) -> None:
    async def bounded() -> None:
        async with asyncio.timeout(240):
            await body

    asyncio.run(bounded())


async def until(condition: Callable[[], bool]) -> None:
    while not condition():
        await asyncio.sleep(0.005)


class TheScout:
    """A scout that has found the victims 7 and 8, and its book."""

    def __init__(self, speed: float = AT_ONCE) -> None:
        self.me = Pretended("scout", speed)
        area = (-27.603853, -48.519300, -27.602955, -48.517300)
        names = ("one", "two")
        self.scout = Scout(self.me, area, lane_width=25, height=20, rescuers=names, patience=60, lease=300, lost=1200)
        self.scout.found |= {7, 8}

    async def claims(self, rescuer: str, victim: int) -> bool:
        return bool(await self.scout.heard(rescuer, "askOne", "claim", victim))

    async def may_drop(self, rescuer: str, victim: int) -> bool:
        return bool(await self.scout.heard(rescuer, "askOne", "may_drop", victim))

    def run(self, body: Callable[[], Coroutine[Any, Any, None]]) -> None:
        async def everything() -> None:
            async with asyncio.TaskGroup() as self.scout.tasks:
                expiring = self.scout.tasks.create_task(body())
                await expiring
                raise Done

        with pytest.raises(ExceptionGroup) as caught:
            run(everything())
        assert caught.value.subgroup(Done), caught.value


class Done(Exception):
    """Ends the promises that still wait."""


def test_a_victim_is_promised_to_the_first_who_claims_it_and_only_that_one_may_drop() -> None:
    book = TheScout(speed=1)

    async def body() -> None:
        assert [await book.claims(*asked) for asked in (("one", 7), ("two", 7), ("one", 7))] == [True, False, True]
        assert not await book.claims("one", 9), "nobody has found it"
        assert book.me.told("held", 7, "one") == [("one", "tell"), ("two", "tell")]
        assert [await book.may_drop(*asked) for asked in (("two", 7), ("one", 7), ("one", 7))] == [False, True, True]
        assert not await book.claims("one", 8), "it has leave for another one"
        await book.scout.heard("one", "tell", "rescued", 7)
        assert not await book.claims("two", 7)
        assert not await book.may_drop("two", 7)
        assert book.scout.missing() == {8}

    book.run(body)


def test_a_rescuer_has_one_victim_at_a_time_and_may_give_it_back() -> None:
    book = TheScout(speed=1)

    async def body() -> None:
        assert await book.claims("one", 7)
        assert await book.claims("one", 8)
        assert book.me.told("held", 7, "one")[2:] == [("one", "untell"), ("two", "untell")]
        assert await book.claims("two", 7)
        await book.scout.heard("two", "achieve", "give_back", 7)
        await book.scout.heard("two", "achieve", "give_back", 8)
        assert list(book.scout.book) == [8]

    book.run(body)


def test_a_promise_ends_with_its_time_but_with_leave_only_when_the_rescuer_is_lost() -> None:
    book = TheScout()

    async def body() -> None:
        time = asyncio.get_running_loop().time
        assert await book.claims("one", 7)
        assert await book.claims("two", 8)
        begun = time()
        assert await book.may_drop("two", 8)
        await until(lambda: 7 not in book.scout.book)
        assert time() - begun >= 300 / AT_ONCE
        assert not await book.may_drop("one", 8)
        await until(lambda: 8 not in book.scout.book)
        assert time() - begun >= 1500 / AT_ONCE

    book.run(body)


def test_a_promise_ends_when_the_rescuer_is_away_for_too_long() -> None:
    book = TheScout(speed=100)

    async def body() -> None:
        time = asyncio.get_running_loop().time
        book.me.away.add("one")
        begun = time()
        assert await book.claims("one", 7)
        assert await book.claims("two", 8)
        await until(lambda: 7 not in book.scout.book)
        assert time() - begun >= 60 / 100
        assert 8 in book.scout.book

    book.run(body)


NEAR, FAR = (-27.6038, -48.518), (-27.6030, -48.518)


@pytest.fixture
def rescuer() -> Any:
    """A rescuer that knows of two victims, 1 near and 2 far, a scout that says yes and a peer that is busy."""
    me = Pretended("one", AT_ONCE)
    me.answers = {("scout", "claim"): True, ("scout", "may_drop"): True, ("two", "bid"): False}
    made = Rescuer(me, height=10, scout="scout", peers=["two"])
    made.victims = {1: NEAR, 2: FAR}
    return made


def served(rescuer: Any, condition: Callable[[], bool], meanwhile: Callable[[], Any] = lambda: None) -> None:
    """Let a rescuer serve until a condition holds."""

    async def body() -> None:
        serving = asyncio.create_task(rescuer.serve())
        await asyncio.sleep(0)
        if (more := meanwhile()) is not None:
            await more
        await until(lambda: condition() or serving.done())
        serving.cancel()
        assert condition()

    run(body())


def test_the_nearest_victim_is_rescued_first_then_the_next_with_a_new_buoy(rescuer: Any) -> None:
    rescuer.search_over = True
    served(rescuer, lambda: rescuer.resting)
    told = [what.args[0] for who, how, what in rescuer.me.sent if (who, how) == ("scout", "tell")]
    assert told == [1, 2]
    fly = ["set_mode", "arm_motors", "takeoff", "goto", "drop_buoy", "return_to_launch", "load_buoy"]
    assert rescuer.me.did == 2 * fly


@pytest.mark.parametrize(("cost", "name"), [(1.0, "two"), (None, "a name before mine")])
def test_a_victim_is_left_to_one_who_is_better_placed(rescuer: Any, cost: float | None, name: str) -> None:
    mine = rescuer.bid(1)[0]
    rescuer.me.answers["two", "bid"] = [mine if cost is None else cost, name]
    if cost is None:  # of victim 2 the bid of the other is the better one, too
        del rescuer.victims[2]
    served(rescuer, lambda: len(rescuer.me.sent) >= 4)
    assert {what.functor for _, _, what in rescuer.me.sent} == {"bid"}


def test_no_buoy_falls_without_leave(rescuer: Any) -> None:
    rescuer.me.answers["scout", "may_drop"] = False
    rescuer.mine = 1
    served(rescuer, lambda: rescuer.mine is None)
    assert "drop_buoy" not in rescuer.me.did


def test_leave_is_asked_for_again_when_no_answer_comes(rescuer: Any) -> None:
    del rescuer.me.answers["scout", "may_drop"]
    rescuer.mine = 1
    served(rescuer, lambda: len(rescuer.me.told("may_drop", 1)) >= 3)
    assert "drop_buoy" not in rescuer.me.did


def test_with_too_little_battery_the_victim_is_given_back(rescuer: Any) -> None:
    rescuer.mine = 1
    rescuer.me.seen["battery"] = [(0, 11.0, 35)]
    served(rescuer, lambda: rescuer.mine is None)
    assert rescuer.me.told("give_back", 1) == [("scout", "achieve")]
    assert rescuer.me.did == []


def test_it_turns_back_when_its_victim_was_promised_to_another(rescuer: Any) -> None:
    rescuer.mine = 1
    rescuer.search_over = True
    del rescuer.victims[2]

    async def lost() -> None:
        await until(lambda: "goto" in rescuer.me.did)
        await rescuer.heard("scout", "tell", "held", 1, "two")

    served(rescuer, lambda: rescuer.resting, lost)
    assert rescuer.me.did == ["set_mode", "arm_motors", "takeoff", "goto", "return_to_launch"]
    assert rescuer.me.told("may_drop", 1) == []


def test_an_open_latch_means_that_the_buoy_has_dropped(rescuer: Any) -> None:
    rescuer.mine = 2
    rescuer.me.seen["latch"] = [(1900,)]
    served(rescuer, lambda: 2 in rescuer.rescued)
    assert rescuer.me.told("rescued", 2) == [("scout", "tell"), ("two", "tell")]
    assert "drop_buoy" not in rescuer.me.did
