"""The simulated turtle: how it moves, and how agents drive it through the bridge daemon on real Zenoh."""

import asyncio
import json
import math
import signal
from pathlib import Path
from typing import Any

import pytest
import zenoh

from bridged.simulation.turtle.turtle import FIELD, STEP, Pen, Turtle, svg
from commd.bus.bus import open_bus
from commd.bus.raw import Sample
from schemas.mission.model import load_mission, read_mission
from schemas.wire import keys
from schemas.wire.records import ActionStatus, Cancel, Outcome, StopOrder
from tests.bridged.sky import end_of
from tests.bridged.studio import MISSIONS, Studio, in_the_studio
from tests.support.buses import served, subscribed, until
from tests.support.notes import identities
from tests.support.processes import running

LAMP = """
mission: lamp
agents: {artist: {program: a.asl, robot: turtle}}
robots: {turtle: {manifest: lamp.toml, prefix: hall}}
"""
LAMP_MANIFEST = """
[robot]
driver = "zenoh"
[percepts.count]
source = "count"
args = ["n"]
rate = 20
[percepts.names]
source = "count"
args = ["name.first"]
"""


def moved(turtle: Turtle, seconds: float) -> Turtle:
    for _ in range(round(seconds / STEP)):
        turtle.step()
    return turtle


def test_a_command_holds_for_a_second() -> None:
    turtle = Turtle(x=1, y=2)
    turtle.command(1.5, 0, 0)
    assert moved(turtle, 0.496).pose() == {
        "x": pytest.approx(1.744),
        "y": 2,
        "theta": 0,
        "linear_velocity": 1.5,
        "angular_velocity": 0,
    }
    assert moved(turtle, 5).x == pytest.approx(2.5, abs=0.03)
    assert turtle.pose()["linear_velocity"] == 0


def test_it_turns_to_the_left_and_moves_where_it_looks() -> None:
    turtle = Turtle(x=5, y=5)
    turtle.command(0, 0, math.pi / 2)
    moved(turtle, 2)
    assert turtle.theta == pytest.approx(math.pi / 2, abs=0.03)
    turtle.command(1, 1, 0)
    moved(turtle, 2)
    assert (turtle.x, turtle.y) == (pytest.approx(4, abs=0.05), pytest.approx(6, abs=0.05))
    turtle.command(0, 0, 4)
    moved(turtle, 2)
    assert -math.pi <= turtle.theta <= math.pi


def test_walls_stop_it() -> None:
    turtle = Turtle()
    turtle.command(10, 0, 0)
    moved(turtle, 2)
    assert turtle.x == FIELD


def test_it_draws_straight_lines_in_one_stroke_and_nothing_with_the_pen_off() -> None:
    turtle = Turtle(x=1, y=1)
    turtle.command(2, 0, 0)
    moved(turtle, 1)
    assert len(turtle.strokes) == 1
    turtle.pen = Pen(off=True)
    turtle.teleport(5, 5, 1)
    assert len(turtle.strokes) == 1
    turtle.pen = Pen(r=255, width=5)
    turtle.teleport_by(1, -1)
    assert (turtle.strokes[1].start, turtle.strokes[1].end) == ((5, 5), (6, 5))
    assert svg(turtle).count("<line") == 2
    turtle.clear()
    assert turtle.strokes == []
    turtle.reset()
    assert turtle == Turtle()


def test_it_is_not_teleported_out_of_its_field() -> None:
    turtle = Turtle()
    with pytest.raises(ValueError, match=r"x: 20 is outside the field, 0\.\.11\.11"):
        turtle.teleport(20, 1, 0)
    assert turtle == Turtle()


async def test_an_agent_drives_it_and_perceives_where_it_is(studio: Studio) -> None:
    await until(lambda: bool(studio.values("pose")), "the pose is perceived")
    x, y, _ = studio.values("pose")
    assert (await studio.do("cmd_vel", 1.5, 0, 0)).state == "succeeded"
    await until(lambda: studio.values("pose")[0] > x + 1.4, "it has moved")  # type: ignore[operator]
    assert studio.values("pose")[1] == y
    await until(lambda: studio.turtle.linear == (0, 0), "it stands")
    assert (await studio.do("set_pen", 255, 0, 0, 2, True)).state == "succeeded"
    assert studio.turtle.pen == Pen(255, 0, 0, 2, True)
    assert (await studio.do("teleport", 2, 3, 0.5)).state == "succeeded"
    await until(lambda: studio.values("pose") == (2, 3, 0.5), "it is perceived there")
    status = await studio.do("teleport", 20, 3, 0.5)
    assert status.state == "failed"
    assert status.reason == "turtle1/teleport_absolute: x: 20 is outside the field, 0..11.11"
    assert (await studio.do("set_pen", 256, 0, 0, 2, True)).state == "refused"
    assert (await studio.do("reset")).state == "succeeded"
    assert (studio.turtle.x, studio.turtle.pen) == (FIELD / 2, Pen())


async def test_it_stands_while_it_is_paused_and_does_then_what_it_was_asked(studio: Studio) -> None:
    async def order(what: str) -> Outcome | None:
        stop, ask = keys.stop(studio.bus.fleet, "turtle"), StopOrder(order=what)  # type: ignore[arg-type]
        (reply,) = [one async for one in studio.bus.query(stop, ask, Outcome, 10)]
        return reply.record

    await until(lambda: bool(studio.values("pose")), "the pose is perceived")
    assert (await studio.do("cmd_vel", 1, 0, 0)).state == "succeeded"
    await until(lambda: studio.turtle.linear[0] == 1, "it moves")
    assert await order("pause") == Outcome(ok=True)
    await until(lambda: studio.turtle.linear == (0, 0), "it stands")
    asked = asyncio.create_task(studio.do("cmd_vel", 2, 0, 0))
    await until(lambda: bool(studio.values("paused")), "it is perceived to be paused")
    assert studio.turtle.linear == (0, 0)
    assert await order("continue") == Outcome(ok=True)
    assert (await asked).state == "succeeded"
    await until(lambda: studio.turtle.linear[0] == 2, "it moves again")


async def test_it_stands_at_the_operators_word_and_is_missed_when_it_is_gone(studio: Studio) -> None:
    await until(lambda: bool(studio.values("pose")), "the pose is perceived")
    assert (await studio.do("cmd_vel", 1, 0, 0)).state == "succeeded"
    await until(lambda: studio.turtle.linear[0] == 1, "it moves")
    stop = keys.stop(studio.bus.fleet, "turtle")
    (reply,) = [one async for one in studio.bus.query(stop, StopOrder(order="hold"), Outcome, 10)]
    assert reply.record.ok
    await until(lambda: studio.turtle.linear == (0, 0), "it stands")
    assert (await studio.do("cmd_vel", 1, 0, 0)).cause == "operator"
    assert [one async for one in studio.bus.query(stop, StopOrder(order="release"), Outcome, 10)]
    studio.leave.set()
    await until(lambda: not studio.values("pose"), "the pose is gone")
    assert end_of(await studio.do("cmd_vel", 1, 0, 0)) == ("failed", "nobody subscribes to turtle1/cmd_vel")
    assert end_of(await studio.do("clear")) == ("failed", "nobody serves turtle1/clear")


SLOW = """
[robot]
driver = "zenoh"
link_loss = "1s"
[orders]
hold = "halt"
[percepts.place]
source = "place"
args = ["data"]
[actions.go]
service = "go"
cancel = "hold"
[actions.late]
service = "go"
deadline = "0.2s"
[actions.halt]
topic = "halt"
"""


async def test_a_robot_of_one_order_holds_when_cancelled_and_when_agentless(endpoint: str, tmp_path: Path) -> None:
    (tmp_path / "lamp.toml").write_text(SLOW)
    mission = read_mission(LAMP, tmp_path / "lamp.yaml")
    async with in_the_studio(endpoint, tmp_path, mission=mission, simulated=False) as studio:
        bus, halts, asked = studio.bus, list[Sample](), list[zenoh.Query]()
        bus._session.declare_queryable("hall/go", zenoh.handlers.Callback(asked.append, indirect=False))
        bus.raw.subscribe("hall/halt", halts.append)
        agent = bus.token(keys.alive(bus.fleet, studio.agent, "agentd", "life"))
        await served(bus, keys.action(bus.fleet, studio.agent, "go"))
        going = asyncio.create_task(studio.do("go"))
        await until(lambda: bool(asked), "it is asked to go")
        cancel = Cancel(header=bus.header("cancel", studio.agent), id=f"{studio.agent}:t:1")
        key = keys.cancel(bus.fleet, studio.agent)
        (reply,) = [one async for one in bus.query(key, cancel, ActionStatus, 10)]
        assert (await going).state == reply.record.state == "cancelled"
        await until(lambda: len(halts) == 1, "it is told to halt")
        status = await studio.do("late")
        assert (status.state, status.reason) == (
            "timed_out",
            "not done within 0.2 s; it waited for the reply of hall/go",
        )
        asked.clear()
        going = asyncio.create_task(studio.do("go"))
        await until(lambda: bool(asked), "it is asked to go again")
        bus.withdraw(agent)
        assert (await going).reason.startswith(f"agent {studio.agent} is lost")
        await until(lambda: len(halts) == 2, "it is told to halt again")
        asked.clear()


async def test_the_papers_listings_drive_it_unchanged(endpoint: str, tmp_path: Path) -> None:
    async with in_the_studio(endpoint, tmp_path, mission=load_mission(MISSIONS / "paper_turtle.yaml")) as studio:
        await until(lambda: bool(studio.values("pose")), "the pose is perceived")
        x, _, _ = studio.values("pose")
        assert (await studio.do("cmd_vel", 1.5, 0.0, 0.0)).state == "succeeded"
        await until(lambda: studio.values("pose")[0] > x + 1.4, "it has moved")  # type: ignore[operator]


async def test_a_pen_whose_colour_alone_the_manifest_names_has_width_0_and_is_on(endpoint: str, tmp_path: Path) -> None:
    section = "[set_pen]\nmethod = service\nname = /turtle1/set_pen\nparams_name = r, g, b\n"
    (tmp_path / "actions").write_text(section + section.replace("[set_pen]", "[broad]") + "defaults = width=9\n")
    (tmp_path / "percepts").write_text("[pose]\nname = /turtle1/pose\nargs = x, y, theta\n")
    text = LAMP.replace("lamp.toml, prefix: hall", "[actions, percepts], simulate: {vehicle: turtle}")
    async with in_the_studio(endpoint, tmp_path, mission=read_mission(text, tmp_path / "lamp.yaml")) as studio:
        await until(lambda: bool(studio.values("pose")), "the pose is perceived")
        assert (await studio.do("set_pen", 255, 0, 10)).state == "succeeded"
        assert studio.turtle.pen == Pen(255, 0, 10, width=0, off=False)
        assert (await studio.do("broad", 255, 0, 10)).state == "succeeded"
        assert studio.turtle.pen.width == 9
        assert (await studio.do("broad", 255, 0, 10, 4)).state == "succeeded"
        assert studio.turtle.pen.width == 4


async def test_500_samples_a_second_are_read_and_told_at_the_manifests_rate(endpoint: str, tmp_path: Path) -> None:
    seconds, rate = 2, 500
    (tmp_path / "lamp.toml").write_text(LAMP_MANIFEST)
    mission = read_mission(LAMP, tmp_path / "lamp.yaml")
    async with in_the_studio(endpoint, tmp_path, mission=mission, simulated=False) as studio:
        await subscribed(studio.bus, "hall/count")
        publisher = studio.bus.raw.publisher("hall/count")
        await until(lambda: publisher.matching, "the bridge listens")
        begin = asyncio.get_running_loop().time()
        for number in range(seconds * rate):
            publisher.put(json.dumps({"n": number, "name": "x"}).encode(), "application/json")
            await asyncio.sleep(begin + number / rate - asyncio.get_running_loop().time())
        await until(lambda: studio.values("count") == (seconds * rate - 1,), "the newest is told")
        assert 5 < studio.told < 1.5 * seconds * 20 + 5
        await until(lambda: studio.health.counters.get("samples", 0) >= seconds * rate, "all are counted")
        assert studio.health.counters["samples_dropped"] == 0
        assert studio.health.counters["percepts_unreadable"] == seconds * rate, "a text has no field `first`"
        publisher.put(b"{", "application/json")
        await until(lambda: studio.health.bad_input == seconds * rate + 1, "what cannot be read is counted")
        assert ("samples_unreadable", "hall/count") in identities(studio.health.notes)


def test_as_a_process_it_ends_when_it_is_told_and_leaves_its_drawing(endpoint: str, tmp_path: Path) -> None:
    async def draw(process: Any) -> None:
        async with open_bus(endpoint, fleet="t", name="b", daemon="commd", mode="router") as bus:
            await asyncio.to_thread(process.says, "simulated turtle on zoo/leo/*")
            poses: list[Sample] = []
            bus.raw.subscribe("zoo/leo/pose", poses.append)
            driver = bus.raw.publisher("zoo/leo/cmd_vel")
            await until(lambda: driver.matching and bool(poses), "the turtle is there")
            driver.put(b'{"linear": {"x": 4}}', "")
            await until(lambda: json.loads(poses[-1].payload)["x"] > 7, "it moves")
            driver.put(b'{"linear": {"x": "fast"}}', "")
            await asyncio.to_thread(process.says, "zoo/leo/cmd_vel: Expected `float`, got `str` - at `$.linear.x`")
            process.signal(signal.SIGTERM)
            assert await asyncio.to_thread(process.ends) == 0

    picture = tmp_path / "turtle.svg"
    options = ["--router", endpoint, "--prefix", "zoo", "--name", "leo", "--draw", str(picture)]
    with running("bridged", "simulate", "turtle", *options) as process:
        asyncio.run(draw(process))
    assert "<line" in picture.read_text()


def test_it_is_told_what_is_wrong_with_its_name() -> None:
    with running("bridged", "simulate", "turtle", "--name", "a*") as process:
        assert process.ends() == 2
        assert "`a*`: expected a key without wildcards" in process.text
