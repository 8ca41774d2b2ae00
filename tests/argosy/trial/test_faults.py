"""Faults of a trial: drawn by seed, within bounds, and read from YAML."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import pytest

from argosy.processes.process_table import KINDS, Process
from argosy.trial.faults import (
    STORM,
    Battery,
    BoardDown,
    ClockStep,
    DiskFull,
    Fault,
    Kill,
    LinkCut,
    LinkNoise,
    Operator,
    Vehicle,
    draw,
    last,
    read,
)
from bridged.simulation.vehicle.fault_injection import Faults
from schemas.files.findings import Findings
from schemas.files.units import Duration
from schemas.mission.model import load_mission

SEEDS = range(1, 301)
TEAM = load_mission("search_and_rescue")


DRAWN = {seed: draw(TEAM, seed) for seed in SEEDS}
ALL = [fault for faults in DRAWN.values() for fault in faults]


def of(kind: type[Any], faults: list[Fault]) -> list[Any]:
    return [one for one in faults if isinstance(one, kind)]


def test_a_seed_draws_the_same_faults_each_time_and_each_seed_others_in_the_order_of_their_times() -> None:
    assert draw(TEAM, 7) == DRAWN[7]
    assert len({"; ".join(map(str, faults)) for faults in DRAWN.values()}) == len(SEEDS)
    assert all(faults == sorted(faults, key=lambda one: one.at) for faults in DRAWN.values())


def test_some_seed_lacks_each_kind_of_fault_and_some_seed_has_it() -> None:
    for kind in (Kill, BoardDown, DiskFull, ClockStep, LinkCut, LinkNoise, Battery, Operator):
        assert {bool(of(kind, faults)) for faults in DRAWN.values()} == {True, False}, kind
    names = [{one.fault.partition("=")[0] for one in of(Vehicle, faults)} for faults in DRAWN.values()]
    for name in ("loss", "duplicate", "cut", "mute-acks", "wind", "gps-loss", "gps-jump", "pilot", "camera"):
        assert {name in drawn for drawn in names} == {True, False}, name


def test_faults_begin_within_the_storm_and_last_as_long_as_they_may() -> None:
    assert all(0 <= one.at <= STORM for one in ALL)
    assert last(ALL) <= STORM + 60
    for kind, least, most in ((BoardDown, 1, 30), (LinkCut, 0, 60), (DiskFull, 1, 20)):
        assert all(least <= one.seconds <= most for one in of(kind, ALL)), kind
    for one in of(Battery, ALL):
        simulate = TEAM.robots[one.robot].simulate
        assert simulate.battery is not None
        assert 0.5 * simulate.battery <= 60 * one.minutes <= simulate.battery


def test_faults_name_what_the_mission_has() -> None:
    assert {one.robot for one in [*of(Vehicle, ALL), *of(Battery, ALL)]} == set(TEAM.robots)
    assert {one.board for one in of(BoardDown, ALL)} == set(TEAM.board_names)
    daemons = {f"commd {board}" for board in TEAM.board_names}
    daemons |= {f"bridged:{robot}" for robot in TEAM.robots}
    daemons |= {f"agentd:{board}" for board in TEAM.boards_with_agents}
    assert {one.daemon for one in of(Kill, ALL)} == daemons
    assert all(one.sender != one.receiver for one in of(LinkCut, ALL))


def test_a_simulated_vehicle_reads_each_of_its_faults_and_all_have_the_same_wind() -> None:
    faults = [Faults.parse([one.fault]) for one in of(Vehicle, ALL)]
    assert 0.01 <= max(one.loss for one in faults) <= 0.3
    assert 0.01 <= max(one.duplicate for one in faults) <= 0.2
    for drawn in DRAWN.values():
        winds = [one.fault.rpartition(":")[0] for one in of(Vehicle, drawn) if one.fault.startswith("wind=")]
        assert len(winds) in (0, len(TEAM.robots))
        assert len(set(winds)) <= 1


def test_missions_without_batteries_links_or_vehicles_draw_no_faults_of_such() -> None:
    single = [fault for seed in SEEDS for fault in draw(load_mission("single_uav"), seed)]
    assert not [one for one in single if isinstance(one, Battery | LinkCut | LinkNoise)]
    turtle = [fault for seed in SEEDS for fault in draw(load_mission("turtle"), seed)]
    assert {type(fault) for fault in turtle} == {Kill, BoardDown, DiskFull, ClockStep, Operator}
    assert {fault.order for fault in of(Operator, turtle)} == {"hold", "pause"}


def test_the_storm_is_over_when_the_last_fault_ends() -> None:
    faults: list[Fault] = [BoardDown(at=10, board="pi1", seconds=30), Kill(at=20, daemon="commd pi1")]
    assert last(faults) == 40
    assert last([]) == 0


def test_drawn_faults_are_read_from_yaml_as_they_were(tmp_path: Path) -> None:
    (path := tmp_path / "storm.yaml").write_bytes(msgspec.yaml.encode(DRAWN[3]))
    assert read(path, TEAM) == DRAWN[3]


def test_each_kind_of_fault_is_written_in_yaml_by_its_name(tmp_path: Path) -> None:
    (path := tmp_path / "storm.yaml").write_text(
        "- {kind: link_cut, at: 30, sender: pi1, receiver: pi2, seconds: 4, both: false}\n"
        "- {kind: board_down, at: 20, board: pi1, seconds: 5}\n"
        "- {kind: kill, at: 10, daemon: bridged uav1}\n"
        "- {kind: vehicle, robot: uav1, fault: mute-acks}\n"
        "- {kind: battery, robot: uav1, minutes: 2.5}\n"
        "- {kind: operator, at: 40, order: hold, robot: uav2, seconds: 9}\n"
        "- {kind: operator, at: 50, order: rtl}\n"
        "- {kind: link_noise, at: 70, sender: pi1, receiver: pi2, seconds: 9, delay: 0.2, bursts: 6}\n"
        "- {kind: clock_step, at: 60, board: pi1, by: -3600}\n"
        "- {kind: disk_full, at: 5, board: pi3, seconds: 8}\n"
    )
    assert list(map(str, read(path, TEAM))) == [
        "uav1: mute-acks",
        "uav1: a full battery lasts 2.5 min",
        "5.0 s: the disk of pi3 is full for 8.0 s",
        "10.0 s: bridged uav1 is killed",
        "20.0 s: board pi1 dies, and is back after 5.0 s",
        "30.0 s: no link one way from pi1 and pi2 for 4.0 s",
        "40.0 s: the operator orders uav2 to hold, and gives it back 9.0 s later",
        "50.0 s: the operator orders every robot to rtl",
        "60.0 s: the clock of pi1 is set by -3600.0 s",
        "70.0 s: 0.200 s late and 6.0 bursts of loss a minute between pi1 and pi2 for 9.0 s",
    ]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("- {kind: kill}", "1:3: 0: needs the field `daemon`"),
        ("- {kind: earthquake}", "1:3: 0: `kind`: expected one of operator, kill, board_down, "),
        (
            "- {kind: vehicel}",
            "1:3: 0: `kind`: expected one of operator, kill, board_down, disk_full, clock_step, link_cut, "
            "link_noise, vehicle, battery, got `vehicel`, did you mean `vehicle`?",
        ),
        ("- {kind: [kill]}", "1:3: 0: `kind`: expected one of operator, kill, "),
        ("- {kind: kill, daemon: commd, at: soon}", '1:35: 0.at: expected a number, got `"soon"`'),
        ("- {kind: kill, daemon: commd, at: -1}", "1:35: 0.at: expected a number >= 0.0, got `-1`"),
        ("- {kind: kill, daemon: commd, when: 3}", "1:31: 0.when: there is no such field; known are at, daemon"),
        ("- {kind: kill, daemon: routerd}", "1:3: expected agentd, bridged, commd, got `routerd`"),
        ("- {kind: kill, daemon: bridged uav9}", "1:3: expected pi1, pi2, pi3, rescuer1, rescuer2, scout, uav1"),
        ("- {kind: board_down, board: pi9, seconds: 1}", "1:3: expected pi1, pi2, pi3, got `pi9`"),
        ("- {kind: clock_step, board: pi9, by: 1}", "1:3: expected pi1, pi2, pi3, got `pi9`"),
        (
            "- {kind: link_noise, sender: pi1, receiver: pi9, seconds: 1, delay: 1}",
            "1:3: expected pi1, pi2, pi3, got `pi9`",
        ),
        ("- {kind: clock_step, board: pi1}", "1:3: 0: needs the field `by`"),
        ("- {kind: battery, robot: uav9, minutes: 1}", "1:3: expected uav1, uav2, uav3, got `uav9`"),
        ("- {kind: operator, robot: uav9, order: hold}", "1:3: expected uav1, uav2, uav3, got `uav9`"),
        ("- {kind: operator, order: fly}", "1:27: 0.order: expected `hold` or `land` or `rtl` or `pause`, got `fly`"),
        ("- {kind: vehicle, robot: uav1, fault: loss=2}", "1:3: expected loss=SHARE ("),
        ("kill", "1:1: expected a list of faults such as"),
    ],
)
def test_a_bad_file_is_named_with_place_and_what_was_expected(tmp_path: Path, text: str, expected: str) -> None:
    (path := tmp_path / "storm.yaml").write_text(text)
    with pytest.raises(Findings) as refused:
        read(path, TEAM)
    place, text = expected.split(": ", 1)
    assert f"{path}:{place}: error: {text}" in str(refused.value)


def test_an_order_in_a_mission_without_robots_is_refused_at_its_line(tmp_path: Path) -> None:
    (path := tmp_path / "storm.yaml").write_text("- {kind: operator, order: rtl, at: 5}\n")
    with pytest.raises(Findings, match=r"storm\.yaml:1:3: error: the mission has no robot for an order"):
        read(path, replace(TEAM, robots={}))


def test_all_that_is_wrong_with_a_file_is_told_also_that_it_is_no_yaml_or_not_there(tmp_path: Path) -> None:
    (path := tmp_path / "storm.yaml").write_text("- {kind: kill}\n- {kind: kill, daemon: commd}\n- {kind: quake}\n")
    with pytest.raises(Findings) as refused:
        read(path, TEAM)
    assert [one.line for one in refused.value.findings] == [1, 3]
    path.write_text("- [")
    with pytest.raises(Findings, match=r"storm\.yaml:2:1: error: not YAML"):
        read(path, TEAM)
    with pytest.raises(Findings, match=r"gone\.yaml"):
        read(tmp_path / "gone.yaml", TEAM)


@pytest.mark.parametrize(
    ("daemon", "killed"),
    [
        ("commd", ["commd pi1", "commd pi2"]),
        ("commd pi2", ["commd pi2"]),
        ("bridged uav2", ["bridged pi2 uav2 uav4"]),
        ("bridged:uav4", ["bridged pi2 uav2 uav4"]),
        ("agentd pi1", ["agentd pi1 scout"]),
        ("agentd", ["agentd pi1 scout", "agentd pi2 rescuer1"]),
        ("simulator uav2", []),
    ],
)
def test_a_kill_hits_a_daemon_by_its_kind_and_its_board_robot_or_agent(daemon: str, killed: list[str]) -> None:
    names = ["commd pi1", "commd pi2", "bridged pi1 uav1", "bridged pi2 uav2 uav4", "agentd pi1 scout"]
    names.append("agentd pi2 rescuer1")
    assert [name for name in names if Kill(daemon=daemon).hits(process(name))] == killed


def process(name: str) -> Process:
    kind, board, *subject = name.split()
    return Process(next(one for one in KINDS if one.name == kind), " ".join(subject), (), board=board)


def test_a_battery_is_drawn_for_the_vehicles_that_have_one() -> None:
    robots = dict(TEAM.robots)
    simulate = robots["uav2"].simulate
    assert simulate is not None
    without = msgspec.structs.replace(simulate, battery=None)
    robots["uav2"] = msgspec.structs.replace(robots["uav2"], simulate=without)
    other = msgspec.structs.replace(simulate, battery=Duration(120))
    robots["uav3"] = msgspec.structs.replace(robots["uav3"], simulate=other)
    mission = replace(TEAM, robots=robots)
    drawn = [one for seed in SEEDS for one in draw(mission, seed) if isinstance(one, Battery)]
    assert {one.robot for one in drawn} == {"uav1", "uav3"}
    assert all(one.minutes <= 2 for one in drawn if one.robot == "uav3")
