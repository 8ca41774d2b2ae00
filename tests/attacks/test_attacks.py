"""Every attack of docs/measurements/attacks.md is refused, and what is allowed is not."""

import asyncio
from collections.abc import Iterator

import pytest

from argosy.doctor.findings import Diagnosis
from argosy.doctor.security_checks import findings
from commd.bus import access_probe
from commd.bus.errors import AccessDenied
from schemas.mission.model import read_mission
from schemas.wire import keys
from schemas.wire.mind_records import MindView
from tests.attacks.admission import ADMISSION
from tests.attacks.links import LINKS
from tests.attacks.mail import MAIL
from tests.attacks.messages import MESSAGES
from tests.attacks.programs import PROGRAMS
from tests.attacks.readers import READERS
from tests.attacks.text_and_files import TEXT_AND_FILES
from tests.attacks.vehicle import VEHICLE
from tests.attacks.world import NAME, TEXT, Attack, World
from tests.support.buses import until
from tests.support.secured import Secured


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    """One fleet for all attacks: it is to survive each of them."""
    with Secured(TEXT) as fleet:
        world = World(fleet)
        world.begin()
        yield world


@pytest.mark.parametrize(
    "attack",
    [*LINKS, *ADMISSION, *READERS, *MESSAGES, *MAIL, *VEHICLE, *PROGRAMS, *TEXT_AND_FILES],
    ids=lambda attack: str(attack.__name__),
)
def test_it_is_refused_and_what_is_allowed_is_not(world: World, attack: Attack) -> None:
    row = asyncio.run(asyncio.wait_for(attack(world), 240))
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
    async def body() -> list[Diagnosis]:
        to = world.member(where) if who == "a member" else world.machine(who, where)
        async with to as bus:
            return await findings(bus, world.fleet.mission)

    printed = asyncio.run(asyncio.wait_for(body(), 240))
    assert {one.level for one in printed} == {"ok"}, printed
    assert all(may in one.text and "as the mission says" in one.text for one in printed)
    assert len(printed) == {"a member": 1, "pi1": 2, "ops": 3, "eye": 3}[who]


def test_the_doctor_says_what_a_router_lets_through_against_the_mission(world: World) -> None:
    """A router whose rules were made when agent `b` lived on pi3, and `c` on pi2."""
    text = (
        world.fleet.path.read_text()
        .replace("b: {board: pi2", "b: {board: pi3")
        .replace("c: {board: pi3", "c: {board: pi2")
    )
    other = read_mission(text.replace("robot: r2", "robot: r1").replace("robot: r3", "robot: r1"), world.fleet.path)

    async def body() -> list[Diagnosis]:
        async with world.machine("pi3", "pi1") as bus:
            return [one for one in await findings(bus, other) if "router of pi1" in one.text]

    printed = asyncio.run(asyncio.wait_for(body(), 240))
    assert [one.level for one in printed] == ["error", "error"]
    assert printed[0].text.startswith(
        "the router of pi1 denies pi3, against the mission, to put on argosy/three/b/health/argosy"
    )
    assert printed[1].text.startswith("the router of pi1 allows pi3, against the mission, to put on argosy/three/c/")
    assert printed[0].do == "write its configuration again (`argosy units MISSION --board pi1`) and restart its commd"


def test_a_daemon_that_its_router_denies_ends_at_once_and_says_what_and_by_whom(world: World) -> None:
    """Agent `b` lives on pi2."""
    where = ("--router", world.fleet.socket("pi1"), "--state", str(world.fleet.folder / "state" / "lost"))
    agentd = world.fleet.run("agentd", "serve", str(world.fleet.path), "b", *where)
    bridged = world.fleet.run("bridged", "serve", str(world.fleet.path), "r2", *where)
    assert (agentd.ends(), bridged.ends()) == (1, 1)
    assert (
        "error: agentd: the router `commd/pi1` denies agentd of `b`: to serve argosy/three/b/control, "
        "to serve argosy/three/b/inbox, and " in agentd.text
    )
    assert (
        "error: bridged: the router `commd/pi1` denies bridged of `r2`: to serve argosy/three/b/action/*"
        in bridged.text
    )
    for daemon in (agentd, bridged):
        assert "by its rules they are not of its board; `argosy units` writes new rules" in daemon.text


async def test_later_denials_are_noted_until_taken_back(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(access_probe, "SETTLING", 0.05)
    monkeypatch.setattr(access_probe, "PATIENCE", 0.3)
    async with world.member("pi1", "a") as bus:
        bus.serve(keys.mind(NAME, "a"), MindView, _nothing)
        await bus.permitted(puts=[keys.health(NAME, "a", "agentd")])
        with pytest.raises(
            AccessDenied, match="denies agentd of `a`: to put on argosy/three/b/health/agentd: by its rules"
        ):
            await bus.permitted(puts=[keys.health(NAME, "b", "agentd"), keys.health(NAME, "a", "agentd")])
        withdraw = bus.serve(keys.mind(NAME, "b"), MindView, _nothing)
        await until(lambda: "to serve argosy/three/b/mind" in bus.access.note, "it is noted")
        withdraw()
        await until(lambda: bus.access.note == "", "it is forgotten")


async def _nothing(query: object) -> None:
    pass
