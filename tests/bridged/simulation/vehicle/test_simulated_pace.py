"""A simulated vehicle tells when it cannot keep up with the time."""

from bridged.simulation.vehicle.process import LATE_S, RealtimeMonitor


def test_a_vehicle_that_keeps_up_says_nothing() -> None:
    said: list[str] = []
    pace = RealtimeMonitor(said.append)
    for number in range(1000):
        pace.round(LATE_S / 2, 0.02 * number)
    pace.report()
    assert said == []
    assert (pace.rounds, pace.late) == (1000, 0)


def test_late_rounds_are_told_at_once_then_now_and_then_and_at_the_end() -> None:
    said: list[str] = []
    pace = RealtimeMonitor(said.append)
    for number in range(100):
        pace.round(0.3 if number % 10 == 0 else 0.0, 0.1 * number)
    assert [words.partition(" rounds")[0] for words in said] == ["late: 1 of 1", "late: 6 of 51"]
    pace.lost += 1.25
    pace.report()
    pace.report()
    assert said[2:] == ["late: 10 of 100 rounds by more than 0.1 s, at worst by 0.3 s; 1.2 s skipped"]
