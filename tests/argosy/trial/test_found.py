"""Defects that trials have found: each run shows that one does not come back."""

import pytest

from argosy.trial.faults import BoardDown, DiskFull, Fault, Kill, Vehicle
from argosy.trial.single_run import Outcome
from tests.argosy.trial.conftest import Fly


def no_action_failed(outcome: Outcome) -> bool:
    """Whether no action failed or was refused: the mission's agent would try it again, and succeed."""
    return not any(end in line for line in outcome.journal for end in ("failed after", "refused after"))


@pytest.mark.parametrize(
    "fault",
    [Kill(at=34.2, daemon="agentd:local"), BoardDown(at=34.2, board="local", seconds=2.0)],
    ids=["agentd", "board"],
)
def test_daemons_that_are_killed_go_on_with_their_files(fly: Fly, fault: Fault) -> None:
    outcome = fly("single_uav", 10, fault, until=60)
    assert any("killed by SIGKILL" in line for line in outcome.journal)
    assert not [line for line in outcome.journal if "corrupt" in line]


def test_a_vehicle_that_landed_while_its_board_was_down_is_home_for_a_bridge_that_has_just_heard_it(fly: Fly) -> None:
    outcome = fly("single_uav", 14, BoardDown(at=75.5, board="local", seconds=11.5))
    assert outcome.success, outcome.why
    assert no_action_failed(outcome)


def test_a_target_waits_for_the_home_of_a_vehicle_that_a_bridge_has_just_heard(fly: Fly) -> None:
    outcome = fly("single_uav", 25, BoardDown(at=21.8, board="local", seconds=12.3))
    assert outcome.success, outcome.why
    assert no_action_failed(outcome)


def test_an_agent_flies_on_while_the_disk_is_full(fly: Fly) -> None:
    outcome = fly("single_uav", 1, DiskFull(at=8, board="local", seconds=10))
    assert any("full" in line for line in outcome.journal)
    assert outcome.success, outcome.why


def test_a_router_that_is_killed_as_its_clients_find_it_back_deafens_none_of_them(fly: Fly) -> None:
    outcome = fly("single_uav", 1, Kill(at=30.0, daemon="commd"), Kill(at=30.5, daemon="commd"))
    assert len([line for line in outcome.journal if "killed by SIGKILL" in line]) == 2
    assert outcome.success, outcome.why


@pytest.mark.parametrize(
    ("seed", "faults"),
    [
        (18, [Vehicle(robot="uav1", fault="cut=4.1+4.3")]),
        (46, [Vehicle(robot="uav1", fault="mute-acks"), BoardDown(at=12.9, board="local", seconds=27.8)]),
    ],
    ids=["arming, then silence", "a target to a vehicle that acknowledges nothing"],
)
def test_what_a_vehicle_does_is_judged_by_its_state_not_its_answers(fly: Fly, seed: int, faults: list[Fault]) -> None:
    outcome = fly("single_uav", seed, *faults)
    assert outcome.success, outcome.why
    assert no_action_failed(outcome)


def test_an_agent_whose_restart_meets_a_bridge_that_dies_gives_up_instead_of_doing_nothing(fly: Fly) -> None:
    outcome = fly("single_uav", 278, BoardDown(at=20.0, board="local", seconds=30.2), Kill(at=51.35, daemon="bridged"))
    assert outcome.why.startswith("uav believes mission_failed"), outcome.why


@pytest.mark.parametrize("mission", ["single_uav", "three_uavs"])
@pytest.mark.parametrize(
    "faults",
    [
        [Vehicle(robot="uav1", fault="cut=18+9"), Vehicle(robot="uav1", fault="pilot=21+60")],
        [Kill(at=16, daemon="bridged:uav1"), Vehicle(robot="uav1", fault="pilot=16.2+60")],
        [Kill(at=16, daemon="agentd"), Vehicle(robot="uav1", fault="pilot=16.2+60")],
        [Vehicle(robot="uav1", fault="cut=16+80"), Vehicle(robot="uav1", fault="pilot=17+3:lands")],
        [Vehicle(robot="uav1", fault="reboot=18")],
    ],
    ids=[
        "while its link is cut",
        "while its bridge is dead",
        "while its agent is dead",
        "and lands it",
        "none: it reboots",
    ],
)
def test_no_program_takes_a_vehicle_from_a_pilot_who_took_over(fly: Fly, mission: str, faults: list[Fault]) -> None:
    outcome = fly(mission, 1, *faults, until=150)
    since = [line for line in outcome.journal if float(line.split()[0]) > 16.3]
    assert not [line for line in since if line.endswith(("uav1: mode GUIDED", "uav1: mode RTL", "uav1: armed"))]


def test_a_vehicle_that_its_pilot_hands_over_after_its_mission_failed_comes_home(fly: Fly) -> None:
    outcome = fly("single_uav", 377, Vehicle(robot="uav1", fault="pilot=21.2+10.3"))
    assert not outcome.violations, outcome.violations
    assert any(line.endswith("uav1: mode RTL") and float(line.split()[0]) > 31 for line in outcome.journal)


def test_a_bridge_that_ends_waits_for_a_vehicle_that_falls_silent_on_the_way_home_its_pilot_chose(fly: Fly) -> None:
    faults = [Vehicle(robot="uav1", fault="cut=54.1+18.8"), Vehicle(robot="uav1", fault="pilot=38.2+9.5")]
    outcome = fly("single_uav", 517, *faults)
    assert not outcome.violations, outcome.violations


def test_a_vehicle_that_was_armed_while_its_bridge_was_dead_is_waited_for(fly: Fly) -> None:
    kills = [Kill(at=at, daemon="bridged:uav1") for at in (25.7, 31.9)]
    outcome = fly("single_uav", 829, BoardDown(at=2.7, board="local", seconds=20.8), *kills)
    assert not outcome.violations, outcome.violations


def test_a_search_waits_until_pilots_hand_their_vehicles_over_and_goes_on(fly: Fly) -> None:
    pilots = [Vehicle(robot="uav1", fault="pilot=31+40"), Vehicle(robot="uav2", fault="pilot=46+40")]
    outcome = fly("search_and_rescue", 1, *pilots)
    assert outcome.success, outcome.why
    for agent, begin, end in (("scout", 31.5, 71), ("rescuer1", 46.5, 86)):
        orders = [line.split() for line in outcome.journal if f" {agent}: set_mode(" in line]
        assert not [line for line in orders if begin < float(line[0]) < end]


def test_an_arming_whose_acknowledgement_is_lost_is_not_reported_as_none(fly: Fly) -> None:
    faults = [Vehicle(robot="uav1", fault=fault) for fault in ("loss=0.27", "cut=9.3+16.3", "seed=58399367")]
    outcome = fly("single_uav", 23, *faults)
    assert not outcome.violations, outcome.violations
    assert "link lost" in outcome.why
