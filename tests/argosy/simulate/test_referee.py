"""The referee of a search and rescue: what fell where, and what it makes of that."""

from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from argosy.__main__ import main
from argosy.processes.simulators import servo_log, victims
from argosy.simulate.referee import drops_of, judge
from bridged.simulation.vehicle.world import ServoMove, Victim
from commd.bus.bus import Bus
from schemas.mission.model import World, load_mission
from schemas.wire import keys
from schemas.wire.records import Perception
from schemas.wire.terms import Term
from tests.argosy.recording.recorders import recording, seen
from tests.support.buses import FLEET, Connect, on_a_bus, subscribed

MISSIONS = Path(__file__).parents[3] / "missions"
MISSION = MISSIONS / "search_and_rescue.yaml"
ONE, OTHER = Victim(1, -27.6030, -48.5180), Victim(2, -27.6032, -48.5180)
METRE = 1 / 111_319.5
"""Degrees of latitude."""


def move(pulse: int, lat: float = ONE.lat, lon: float = ONE.lon, *, home: float = 100.0, output: int = 9) -> ServoMove:
    """An output moved in the air, or at home on the ground."""
    away = home > 5
    return ServoMove(1.0, 1, output, pulse, lat, lon, 10.0 if away else 0.0, home, away)


def fell(*moves: ServoMove) -> int:
    return len(drops_of("uav2", moves))


def test_a_buoy_falls_when_the_latch_opens() -> None:
    assert fell(move(1900)) == 1
    assert fell(move(1100)) == 0
    assert fell(move(1900, output=10)) == 0


def test_an_open_latch_drops_nothing_more() -> None:
    assert fell(move(1900), move(1950), move(1800)) == 1


def test_a_latch_that_is_closed_in_the_air_has_no_other_buoy() -> None:
    assert fell(move(1900), move(1100), move(1900)) == 1


def test_another_buoy_is_taken_at_home_on_the_ground() -> None:
    assert fell(move(1900), move(1100, home=0.0), move(1900)) == 2


def test_each_victim_with_one_buoy_passes() -> None:
    verdict = judge([ONE, OTHER], drops_of("a", [move(1900)]) + drops_of("b", [move(1900, OTHER.lat)]))
    assert verdict.good
    assert str(verdict).endswith("PASSED: 2 of 2 victims got exactly one buoy")


def test_a_victim_without_a_buoy_fails() -> None:
    verdict = judge([ONE, OTHER], drops_of("a", [move(1900)]))
    assert str(verdict).endswith("FAILED: 1 of 2 victims got exactly one buoy, 1 none")


def test_a_victim_with_two_buoys_fails() -> None:
    verdict = judge([ONE], drops_of("a", [move(1900)]) + drops_of("b", [move(1900)]))
    assert str(verdict).endswith("FAILED: 0 of 1 victims got exactly one buoy, 1 more than one")


@pytest.mark.parametrize(("metres", "good"), [(4.9, True), (5.1, False)])
def test_a_buoy_helps_within_five_metres_and_is_astray_beyond(metres: float, good: bool) -> None:
    verdict = judge([ONE], drops_of("a", [move(1900, ONE.lat + metres * METRE)]))
    assert verdict.good == good
    assert len(verdict.astray) == (not good)


@pytest.fixture
def flown(tmp_path: Path) -> Callable[[int], Path]:
    """Return what writes the logs of a run in which that many of the mission's victims got a buoy."""

    def write(count: int) -> Path:
        world = load_mission(MISSION).world
        assert isinstance(world, World)
        moves: list[ServoMove] = []
        for victim in victims(world)[:count]:
            moves += [move(1900, victim.lat, victim.lon), move(1100, home=0.0)]
        for robot, its in (("uav1", []), ("uav2", moves), ("uav3", [])):
            servo_log(tmp_path, robot).write_bytes(b"".join(msgspec.json.encode(one) + b"\n" for one in its))
        return tmp_path

    return write


@pytest.mark.parametrize(("count", "code", "said"), [(8, 0, "PASSED: 8 of 8"), (7, 1, "FAILED: 7 of 8")])
def test_a_run_is_judged_by_the_world_of_its_mission_and_the_logs_of_its_copters(
    flown: Callable[[int], Path], capsys: pytest.CaptureFixture[str], count: int, code: int, said: str
) -> None:
    assert main(["referee", str(MISSION), str(flown(count))]) == code
    assert said in capsys.readouterr().out


def test_a_run_without_logs_is_not_judged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["referee", str(MISSION), str(tmp_path)]) == 2
    assert "uav1.servo.jsonl" in capsys.readouterr().err


def test_a_mission_without_a_world_is_not_judged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["referee", str(MISSIONS / "single_uav.yaml"), str(tmp_path)]) == 2
    assert "has no `world`" in capsys.readouterr().err


class Told:
    """What a rescuer and a scout perceive in a flight, put on a real bus as their bridges do."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.count = 0

    def percept(self, name: str, *parameters: Term, agent: str = "rescuer1") -> None:
        record = Perception(header=self.bus.header("percepts", agent), name=name, parameters=parameters)
        self.bus.put(keys.percept(FLEET, agent, name), record)
        self.count += agent == "rescuer1" and name == "latch"

    def rescue(self, victim: Victim) -> None:
        """Drop a buoy and take another one at home."""
        self.percept("state", "GUIDED", True, True)
        self.percept("global_pos", victim.lat, victim.lon)
        self.percept("latch", 1900)
        self.percept("global_pos", *HOME)
        self.percept("state", "RTL", True, False)
        self.percept("latch", 1100)


HOME = (-27.604033, -48.518262)


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    """Return the shipped mission in the fleet of the tests; only one of its rescuers is a copter of the recording."""
    text = MISSION.read_text(encoding="utf-8").replace("fleet: sar", f"fleet: {FLEET}")
    text = text.replace(": search_and_rescue/", f": {MISSIONS}/search_and_rescue/")
    begin, end = text.index("  uav3:"), text.index("world:")
    text = (text[:begin] + text[end:]).replace("    robot: uav3\n", "").replace("victims: 8", "victims: 2")
    path = tmp_path / "mission.yaml"
    path.write_text(text)
    return path


def recorded(endpoint: str, file: Path, rescued: list[Victim], found: list[Victim], first: int = 1100) -> None:
    """Record a flight by `argosy record`, in which the latch stood at `first` in the beginning."""

    async def body(connect: Connect) -> None:
        told = Told(await connect("uav2", "bridged"))
        async with recording(endpoint, file) as recorder:
            for agent, name in (("rescuer1", "latch"), ("scout", "victim")):
                await subscribed(told.bus, keys.percept(FLEET, agent, name))
            told.percept("home_pos", *HOME)
            told.percept("global_pos", *HOME)
            told.percept("state", "STABILIZE", True, False)
            told.percept("latch", first)
            told.percept("latch", 1100)
            for victim in found:
                told.percept("victim", victim.number, victim.lat, victim.lon, agent="scout")
            for victim in rescued:
                told.rescue(victim)
            await seen(file, keys.percept(FLEET, "rescuer1", "latch"), told.count)
            assert (await recorder.end())[0] == 0

    on_a_bus(endpoint, body)


@pytest.mark.parametrize(("count", "code", "said"), [(2, 0, "PASSED: 2 of 2"), (1, 1, "FAILED: 1 of 2")])
def test_a_flight_of_real_vehicles_is_judged_by_its_recording(
    endpoint: str, mission: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], count: int, code: int, said: str
) -> None:
    world = load_mission(mission).world
    assert world is not None
    recorded(endpoint, tmp_path / "flight.mcap", victims(world)[:count], [], first=1900)
    file = tmp_path / "flight.mcap"
    assert main(["referee", str(mission), str(file)]) == code
    assert said in capsys.readouterr().out
    file.write_bytes(file.read_bytes()[:-1])
    assert main(["referee", str(mission), str(file)]) == 1
    assert "; not all is known: " in capsys.readouterr().out


def test_without_a_world_the_victims_are_those_that_a_camera_told_of(
    endpoint: str, mission: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = mission.read_text()
    text = text[: text.index("world:")] + text[text.index("done:") :]
    mission.write_text(text.replace("      camera: 16m\n", ""))
    recorded(endpoint, tmp_path / "flight.mcap", [ONE], [ONE, OTHER])
    assert main(["referee", str(mission), str(tmp_path / "flight.mcap")]) == 1
    said = capsys.readouterr().out
    assert "1 of 2 victims got exactly one buoy, 1 none" in said
    assert "astray" not in said


def test_a_recording_of_something_else_is_not_judged(
    endpoint: str, mission: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "flight.mcap"
    recorded(endpoint, file, [], [])
    assert main(["referee", str(MISSION), str(file)]) == 2
    assert f"expected a recording of fleet `sar`, it has {FLEET}" in capsys.readouterr().err
    assert main(["referee", str(MISSION), str(mission)]) == 2
    assert "not an MCAP file" in capsys.readouterr().err
