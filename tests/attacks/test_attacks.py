"""Every attack of docs/attacks.md is refused, and what is allowed is not."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator

import pytest

from argosy.diagnosis import Said
from argosy.doctor_access import findings
from schemas.mission import read_mission
from tests.attacks.links import LINKS
from tests.attacks.messages import MESSAGES
from tests.attacks.world import TEXT, Attack, World
from tests.support.secured import Secured


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    """One fleet for all attacks: it is to survive each of them."""
    with Secured(TEXT) as fleet:
        world = World(fleet)
        world.begin()
        yield world


@pytest.mark.parametrize("attack", [*LINKS, *MESSAGES], ids=lambda attack: str(attack.__name__))
def test_it_is_refused_and_what_is_allowed_is_not(world: World, attack: Attack) -> None:
    row = asyncio.run(asyncio.wait_for(attack(world), 90))
    assert row.problems == []
    assert row.seen


@pytest.mark.parametrize(
    ("who", "where", "may"),
    [
        ("a member", "pi1", "a daemon of pi1"),
        ("pi1", "pi2", "pi1"),
        ("ops", "pi3", "operator ops"),
        ("eye", "pi1", "observer"),
    ],
)
def test_the_doctor_proves_what_somebody_may_and_may_not_do(world: World, who: str, where: str, may: str) -> None:
    async def body() -> list[Said]:
        to = world.member(where) if who == "a member" else world.machine(who, where)
        async with to as bus:
            return await findings(bus, world.fleet.mission)

    said = asyncio.run(asyncio.wait_for(body(), 60))
    assert {one.level for one in said} == {"ok"}, said
    assert all(may in one.text and "as the mission says" in one.text for one in said)
    assert len(said) == {"a member": 1, "pi1": 2, "ops": 3, "eye": 3}[who]


def test_the_doctor_says_what_a_router_lets_through_against_the_mission(world: World) -> None:
    """A router whose rules were made when agent `b` lived on pi3, and `c` on pi2."""
    text = (
        world.fleet.path.read_text()
        .replace("b: {board: pi2", "b: {board: pi3")
        .replace("c: {board: pi3", "c: {board: pi2")
    )
    other = read_mission(text.replace("robot: r2", "robot: r1").replace("robot: r3", "robot: r1"), world.fleet.path)

    async def body() -> list[Said]:
        async with world.machine("pi3", "pi1") as bus:
            return [one for one in await findings(bus, other) if "router of pi1" in one.text]

    said = asyncio.run(asyncio.wait_for(body(), 60))
    assert [one.level for one in said] == ["error", "error"]
    assert said[0].text.startswith(
        "the router of pi1 denies pi3, against the mission, to put on argosy/three/b/health/argosy"
    )
    assert said[1].text.startswith("the router of pi1 lets pi3, against the mission, put on argosy/three/c/")
    assert said[0].do == "make its configuration anew (`argosy units MISSION --board pi1`) and start its commd again"
