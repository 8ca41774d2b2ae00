"""The radio model: who hears whom, what is lost, how long it takes; on a bus, by where the simulated robots are."""

import contextlib
import math
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from commd.bus.bus import Bus, Query
from commd.gateway.radio_model import RadioAir, RadioModel
from schemas.files.units import Distance, Duration
from schemas.mission.model import Mission, Radio, read_mission
from schemas.wire import keys
from schemas.wire.records import Header, Perception
from schemas.wire.terms import Number, Term
from tests.support.buses import FLEET, Connect, subscribed, under_way, until

HOME = (-27.604033, -48.518363)
MISSION = """
mission: far
boards: {pi1: {}, pi2: {}, base: {}}
agents:
  scout: {program: s.asl, robot: uav1, board: pi1}
  mapper: {program: s.asl, robot: uav1, board: pi1}
  rescuer: {program: r.asl, robot: uav2, board: pi2}
  chief: {program: c.asl, board: base}
robots:
  uav1: {manifest: copter, link: "udpin:127.0.0.1:1", board: pi1, simulate: {home: [-27.604033, -48.518363, 21]}}
  uav2: {manifest: copter, link: "udpin:127.0.0.1:2", board: pi2, simulate: {home: [-27.604033, -48.518363, 21]}}
radio: {range: 300m}
"""


def north(metres: float) -> tuple[float, float]:
    return HOME[0] + metres / 111_195, HOME[1]


def fates(model: RadioModel, sender: str, receiver: str, count: int) -> list[bool]:
    return [model.send(0.0, sender, receiver, 100).lost for _ in range(count)]


def test_equal_seeds_lose_equal_transmissions_of_a_pair_whatever_others_say() -> None:
    alone, crowded = RadioModel(Radio(loss=0.3, seed=7)), RadioModel(Radio(loss=0.3, seed=7))
    mixed: list[bool] = []
    for _ in range(200):
        mixed += fates(crowded, "uav1", "uav2", 1)
        fates(crowded, "uav2", "uav1", 3)
    assert fates(alone, "uav1", "uav2", 200) == mixed
    assert mixed != fates(RadioModel(Radio(loss=0.3, seed=8)), "uav1", "uav2", 200)
    assert mixed != fates(RadioModel(Radio(loss=0.3, seed=7)), "uav2", "uav1", 200)


@pytest.mark.parametrize("loss", [0.0, 0.1, 0.5, 0.9])
def test_as_much_is_lost_as_is_declared(loss: float) -> None:
    count = 20_000
    lost = sum(fates(RadioModel(Radio(loss=loss, seed=1)), "uav1", "uav2", count))
    assert abs(lost / count - loss) <= 4 * math.sqrt(loss * (1 - loss) / count)


def test_a_line_sends_one_after_another_and_each_direction_is_a_line_of_its_own() -> None:
    model = RadioModel(Radio(bandwidth=8000, delay=Duration(0.5)))
    assert [model.send(10.0, "uav1", "uav2", size).arrives for size in (1000, 2000, 500)] == [11.5, 13.5, 14.0]
    assert model.send(10.0, "uav2", "uav1", 1000).arrives == 11.5
    assert model.send(10.0, "uav1", "uav3", 1000).arrives == 11.5
    assert model.send(60.0, "uav1", "uav2", 1000).arrives == 61.5


def test_without_bandwidth_size_takes_no_time() -> None:
    assert RadioModel(Radio(delay=Duration(0.25))).send(1.0, "uav1", "uav2", 10**6).arrives == 1.25


def test_robots_hear_each_other_within_range_and_while_nobody_knows_where_they_are() -> None:
    model = RadioModel(Radio(range=Distance(300)))
    assert model.in_range("uav1", "uav2")
    model.place("uav1", HOME)
    assert model.in_range("uav1", "uav2")
    model.place("uav2", north(299))
    assert model.in_range("uav1", "uav2")
    model.place("uav2", north(301))
    assert not model.in_range("uav1", "uav2")
    assert RadioModel(Radio()).in_range("uav1", "uav2")


def mission(text: str = MISSION) -> Mission:
    return read_mission(text, Path("far.yaml"))


@contextlib.asynccontextmanager
async def on_air(connect: Connect, declared: Mission) -> AsyncIterator[tuple[RadioAir, Bus]]:
    """The air of a board, and a session that stands for the bridges."""
    assert declared.radio is not None
    air = RadioAir(await connect("pi1", "commd"), declared, declared.radio, "pi1")
    async with under_way(air.run()):
        yield air, await connect("uav2", "bridged")


def told(*parameters: Term) -> Perception:
    return Perception(header=Header(seq=1, boot="b"), name="global_pos", parameters=parameters)


async def test_agents_hear_each_other_by_where_their_simulated_robots_are(connect: Connect) -> None:
    async with on_air(connect, mission()) as (air, bridge):
        assert await air.carries("scout", "rescuer", 100)
        key = keys.percept(FLEET, "rescuer", "global_pos")
        await subscribed(bridge, key)
        bridge.put(key, told(Number("NaN"), "nonsense"))
        bridge.put(key, told(*north(500)))
        await until(lambda: not air._model.in_range("uav1", "uav2"), "the rescuer's robot is far away")
        assert not await air.carries("scout", "rescuer", 100)
        assert not await air.carries("rescuer", "mapper", 100)
        assert await air.carries("scout", "mapper", 100)  # one robot
        assert await air.carries("chief", "rescuer", 100)  # a station
        assert air.counters == {"radio_sent": 4, "radio_out_of_range": 2, "radio_lost": 0}


async def test_the_position_of_a_robot_that_stands_still_is_asked_for(connect: Connect) -> None:
    bridge = await connect("uav2", "bridged")
    key = keys.percept(FLEET, "rescuer", "global_pos")

    async def answer(query: Query[Perception]) -> None:
        query.reply(told(*north(500)), key)

    bridge.serve(keys.percept(FLEET, "rescuer", "**"), Perception, answer)
    async with on_air(connect, mission()) as (air, _):
        await until(lambda: not air._model.in_range("uav1", "uav2"), "the robot's position is known")


async def test_a_degraded_air_is_said_at_the_start(connect: Connect, caplog: pytest.LogCaptureFixture) -> None:
    text = MISSION.replace("{range: 300m}", "{range: 300m, loss: 0.1, delay: 20ms, bandwidth: 250000}")
    async with on_air(connect, mission(text)):
        pass
    assert (
        "mail between boards is degraded on purpose, as the mission declares: "
        "range 300m, loss 0.1, delay 20ms, bandwidth 250000 bit/s" in caplog.text
    )
