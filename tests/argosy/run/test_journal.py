"""The journal of a run, and the model behind it, from records alone."""

import io
from contextlib import suppress

import pytest

from argosy.cli import journal as module
from argosy.cli.journal import Journal
from argosy.fleet_model.robots import Track
from argosy.run.end_conditions import Ending
from argosy.run.summary import summary
from schemas.wire.records import Note
from tests.argosy.recorded import START, Recording, flight


def test_what_changes_is_told_once_and_in_order() -> None:
    recording = Recording()
    for _ in range(3):
        recording.percept("state", "GUIDED", True, True)
    assert recording.lines == ["uav1: vehicle connected", "uav1: mode GUIDED", "uav1: armed"]


def test_an_action_is_told_at_its_start_and_at_its_end_with_duration_and_reason() -> None:
    recording = Recording()
    recording.action(1, "takeoff", "accepted", 5)
    recording.at = 6.25
    recording.action(1, "takeoff", "running", 5)
    assert len(recording.model.actions.open()) == 1
    recording.action(1, "takeoff", "failed", 5, reason="fence breached")
    recording.action(1, "takeoff", "running", 5)  # a late one changes nothing
    assert recording.lines == ["uav: takeoff(5)", "uav: takeoff(5) failed after 6.2 s: fence breached"]
    recording.action(2, "land", "refused", reason="held by scout")
    assert recording.lines[2:] == ["uav: land refused after 0.0 s: held by scout"]
    assert recording.model.actions.open() == []


def test_an_action_that_had_begun_before_it_was_heard_took_longer_than_is_known() -> None:
    recording = Recording()
    recording.action(1, "takeoff", "running", 5)
    recording.at = 1.5
    recording.action(1, "takeoff", "succeeded", 5)
    assert recording.lines == ["uav: takeoff(5)", "uav: takeoff(5) succeeded after more than 1.5 s"]


def test_a_vehicle_that_falls_silent_in_flight_is_lost_in_its_last_known_state() -> None:
    recording = Recording(1.0)
    recording.percept("state", "GUIDED", True, True)
    recording.percept("altitude", 39.2)
    recording.at = 3.0
    recording.percept("global_pos", -27.6037, -48.5181)
    recording.at = 8.0
    recording.percept("state", "", False, False)
    recording.percept("state", "", False, False)
    robot = recording.model.robots["uav1"].seen
    told = "uav1: LOST: last heard 5 s ago, armed, GUIDED, 39 m up at -27.603700, -48.518100"
    assert recording.lines[3:] == [told]
    assert recording.status.journal.entries[-1].level == "error"
    assert (robot.lost, robot.armed, robot.mode) == (True, True, "GUIDED")
    assert recording.status.flying()
    recording.percept("state", "RTL", True, False)
    assert recording.lines[4:] == ["uav1: vehicle heard again", "uav1: mode RTL", "uav1: disarmed"]


def test_a_robot_that_is_no_vehicle_is_known_by_its_percepts() -> None:
    recording = Recording()
    recording.percept("state", "", False, False)
    assert recording.model.robots["uav1"].seen.reported == {}
    recording.percept("pose", 5.5, 5.5, 0)
    recording.percept("seen", "x" * 100)
    assert list(recording.model.robots["uav1"].seen.reported) == ["pose", "seen"]
    recording.percept_gone("seen")
    assert "uav1       pose(5.5,5.5,0)" in summary(recording.status, Ending(0, "done"), [("startup", 1.0)])
    recording.percept("state", "GUIDED", True, False)
    assert recording.model.robots["uav1"].seen.reported == {}


def test_a_warning_of_a_daemon_is_told_while_it_is_new() -> None:
    recording = Recording()
    none = Note("failsafe_none", "no failsafe is on")
    for notes in ((none,), (none,), ()):
        recording.health("uav1", "bridged", notes=notes)
    for seconds in (6, 7):
        silent = [Note("source_silent", f"{key} silent for {seconds} s", key, seconds) for key in ("pose", "scan")]
        recording.health("uav1", "bridged", notes=tuple(silent))
    assert recording.lines == ["uav1: no failsafe is on", "uav1: pose silent for 6 s", "uav1: scan silent for 6 s"]


def test_an_alarm_is_told_as_an_error() -> None:
    recording = Recording()
    recording.health("uav1", "bridged", notes=(Note("robot_unattended", "alone"),))
    assert recording.status.journal.entries[-1].level == "error"
    assert recording.lines == ["uav1: alone"]


def test_the_track_knows_length_height_and_when_the_vehicle_was_armed() -> None:
    track = flight().model.robots["uav1"].seen.track
    assert track.highest() == 40
    assert 98 < track.length() < 101  # there and back over 49.6 m
    assert [track.armed(START + second / 5) for second in (1, 30, 61)] == [False, True, False]


def test_a_long_track_is_thinned_and_keeps_its_ends() -> None:
    track = Track(most=100)
    for second in range(1000):
        track.moved(second, -27.6 + second * 1e-7, -48.5)
    assert 25 < len(track.points) <= 101
    assert track.points[0].at == 0
    assert track.points[-1].at > 980


def test_the_log_has_every_line_up_to_a_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_LOGGED", 1000)
    log = io.StringIO()
    journal = Journal(lambda: 1.5, log)
    for number in range(1010):
        journal.add("commd", f"line {number}")
    lines = log.getvalue().splitlines()
    assert lines[0] == "     1.5 s  commd: line 0"
    assert lines[-1] == "the log ends here: 1000 lines"
    assert len(lines) == 1001
    assert len(journal.entries) == 500


def test_a_full_disk_does_not_end_a_flight() -> None:
    with open("/dev/full", "w") as log:
        journal = Journal(lambda: 0.0, log)
        journal.add("uav", "hello")
        journal.add("uav", "again")
        assert [entry.text for entry in journal.entries] == [
            "hello",
            "writing the log has failed and stops: No space left on device",
            "again",
        ]
        with suppress(OSError):
            log.close()
