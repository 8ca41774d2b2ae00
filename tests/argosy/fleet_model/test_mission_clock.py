"""The mission's clock, by what minds tell of it."""

from argosy.fleet_model.mission_clock import MissionClock
from tests.argosy.fleet_model.fleet import rescue


def run(clock: MissionClock, begins: float, until: float, speed: float, zero: float, agent: str = "scout") -> None:
    """An agent is heard every 2 s, between two wall times."""
    at = begins
    while at <= until:
        clock.look(agent, (at - zero) * speed, at)
        at += 2.0


def test_the_speed_and_second_zero_are_measured() -> None:
    clock = MissionClock(None)
    run(clock, 1020.0, 1030.0, speed=2.0, zero=1000.0)
    assert (clock.speed, clock.zero) == (2.0, 1000.0)


def test_a_fleet_that_was_started_anew_has_a_new_second_zero_and_its_speed_stays() -> None:
    clock = MissionClock(None)
    run(clock, 1020.0, 1300.0, speed=2.0, zero=1000.0)
    clock.begin()
    run(clock, 1360.0, 1362.0, speed=2.0, zero=1350.0)
    assert (clock.speed, clock.zero) == (2.0, 1350.0)
    run(clock, 1364.0, 1380.0, speed=2.0, zero=1350.0)
    assert (clock.speed, clock.zero) == (2.0, 1350.0)


def test_a_restart_in_which_the_new_life_is_heard_late_is_noticed_too() -> None:
    clock = MissionClock(None)
    run(clock, 1002.0, 1010.0, speed=1.0, zero=1000.0)
    run(clock, 1500.0, 1520.0, speed=1.0, zero=1400.0)  # older by its clock than the one before ever was
    assert (clock.speed, clock.zero) == (1.0, 1400.0)


def test_a_run_that_began_while_nobody_looked_has_its_own_second_zero_at_any_speed() -> None:
    clock = MissionClock(None)
    run(clock, 1075.0, 1095.0, speed=2.0, zero=1000.0)
    run(clock, 1430.0, 1450.0, speed=2.0, zero=1262.0)  # mission seconds 336 and on, later than 190 before
    assert (clock.speed, clock.zero) == (2.0, 1262.0)


def test_a_lost_router_changes_neither() -> None:
    clock = MissionClock(None)
    run(clock, 1002.0, 1030.0, speed=5.0, zero=1000.0)
    run(clock, 1200.0, 1230.0, speed=5.0, zero=1000.0)
    assert (clock.speed, clock.zero) == (5.0, 1000.0)


def test_one_agent_that_comes_anew_does_not_set_the_clock_of_the_others_back() -> None:
    clock = MissionClock(None)
    for at in range(1002, 1040, 2):
        clock.look("scout", float(at - 1000), float(at))
        if at > 1020:
            clock.look("rescuer1", float(at - 1020), float(at))
    assert clock.zero == 1000.0


def test_the_clock_of_a_fleet_goes_on_when_its_only_agent_is_restarted() -> None:
    clock = MissionClock(None)
    run(clock, 1002.0, 1030.0, speed=2.0, zero=1000.0)
    run(clock, 1034.0, 1060.0, speed=2.0, zero=1032.0)
    assert (clock.zero, clock.seconds(1060.0)) == (1000.0, 120.0)


def test_an_agent_that_was_restarted_before_its_time_was_seen_to_go_back_does_not_set_the_clock_back_either() -> None:
    clock = MissionClock(None)
    run(clock, 1002.0, 1010.0, speed=1.0, zero=1000.0)
    clock.restarted("scout")
    run(clock, 1100.0, 1120.0, speed=1.0, zero=1080.0)
    assert clock.seconds(1120.0) == 120.0


def test_the_clock_of_the_run_counts_before_those_of_the_minds() -> None:
    clock = MissionClock(None)
    run(clock, 1012.0, 1020.0, speed=2.0, zero=1010.0)
    for at in range(1020, 1030):
        clock.look_at_run((at - 1000) * 2.0, 2.0, float(at))
        clock.look("scout", (at - 1010) * 2.0, float(at))
    assert (clock.speed, clock.zero) == (2.0, 1000.0)
    clock.look_at_run(2.0, 2.0, 1101.0)  # another run
    assert clock.zero == 1100.0


def test_a_time_that_is_no_number_is_no_time() -> None:
    clock = MissionClock(None)
    clock.look("scout", float("inf"), 1000.0)
    clock.look("scout", float("nan"), 1000.0)
    assert clock.zero is None


def test_the_model_has_it_from_every_mind_that_is_heard() -> None:
    fleet = rescue()
    for second in range(5):
        fleet.mind("scout", time=float(second)).waits(1)
    assert fleet.model.clock.zero == 1_000_000.0
