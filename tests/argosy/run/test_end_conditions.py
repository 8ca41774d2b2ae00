"""What ends a run, from records alone."""

import re
from dataclasses import replace

import msgspec
import pytest

from argosy.processes.supervisor import Supervisor
from argosy.run.end_conditions import ANSWERED, NOTHING_LEFT, EndConditions, Ending
from argosy.run.summary import summary
from schemas.mission.model import NO_STEPS
from schemas.wire import keys
from schemas.wire.mind_records import MindView
from schemas.wire.records import Note, Order
from schemas.wire.terms import Atom
from tests.argosy.recorded import Recording
from tests.argosy.run.test_screen import in_flight, screen


class Looked:
    """What ends the run of a recording, looked at by a clock of its own."""

    def __init__(self, recording: Recording) -> None:
        self.at = 1.0
        supervisor = Supervisor(lambda child, line: None, lambda child: None)
        self._end_conditions = EndConditions(recording.status, supervisor, lambda: self.at)

    def look(self, later: float = 0.0) -> Ending | None:
        """Look so many seconds later."""
        self.at += later
        return self._end_conditions.look()


def look(recording: Recording) -> Ending | None:
    """Return whether the run of a recording has ended, an operator's order having had the time to be answered."""
    looked = Looked(recording)
    return looked.look() or looked.look(ANSWERED)


def ordered(order: Order) -> Recording:
    """Return a recording in which an operator stops a flight to a waypoint."""
    recording = in_flight()
    recording.action(1, "goto", "failed", -27.603683, -48.518052, 40, by_operator=order)
    return recording


def test_an_operators_order_is_told_and_ends_the_run_when_the_vehicle_is_down() -> None:
    recording = ordered("land")
    assert recording.lines[-1] == "uav1: the operator orders land"
    assert "stopped by the operator (land)" in screen(recording)[0]
    assert look(recording) is None
    recording.percept("state", "LAND", True, False)
    assert look(recording) == Ending(1, "stopped by the operator: land")


def test_hold_keeps_the_run_going_and_says_how_to_give_the_robot_back() -> None:
    recording = ordered("hold")
    told = "uav1: the operator orders hold; `argosy stop release uav1` gives it back to its agents"
    assert recording.lines[-1] == told
    recording.percept("state", "LAND", True, False)
    assert look(recording) is None
    recording.model.released("uav1")
    assert recording.lines[-1] == "uav1: released by the operator: its agents act again"
    assert "stopped" not in screen(recording)[0]


def test_a_pause_is_shown_and_the_timeout_waits_for_its_end() -> None:
    recording = in_flight()
    recording.at, recording.status.timeout_at = 50.0, 60.0
    looked = Looked(recording)
    recording.percept("paused", Atom("operator"))
    assert recording.lines[-1] == "uav1: paused by the operator; `argosy stop continue uav1` lets it go on"
    assert "paused (uav1)" in screen(recording)[0]
    recording.at = 500.0
    assert looked.look() is None
    recording.percept_gone("paused")
    assert recording.lines[-1] == "uav1: goes on: no longer paused"
    assert "paused (" not in screen(recording)[0]
    recording.at = 509.0
    assert looked.look() is None
    recording.at = 511.0
    assert looked.look() is not None


def test_an_agent_that_gives_up_does_not_end_the_operators_order() -> None:
    recording = ordered("land")
    recording.fail('mission_failed("operator: land")[source(self)]')
    assert look(recording) is None
    why = 'uav believes mission_failed("operator: land"); the run goes on under an operator\'s order'
    assert recording.lines.count(f"argosy: {why}") == 1
    looked = Looked(recording)
    for battery in range(3):  # a belief that changes is reported once
        recording.fail(f"mission_failed({battery})[source(self)]")
        assert looked.look() is None
    assert sum("the run goes on under" in line for line in recording.lines) == 2
    recording.percept("state", "LAND", True, False)
    assert look(recording) == Ending(1, "stopped by the operator: land")


def test_a_run_is_there_until_an_order_on_the_ground_is_answered_and_ends_with_the_order_as_its_reason() -> None:
    recording = ordered("hold")
    recording.percept("state", "STABILIZE", True, False)
    recording.fail('mission_failed("operator: hold")[source(self)]')
    looked = Looked(recording)
    assert looked.look() is None
    assert looked.look(ANSWERED) == Ending(1, "stopped by the operator: hold")


@pytest.mark.parametrize("prevented", ["", "armed", "the agent acts", "intends something", "a client", "on_idle: none"])
def test_a_run_ends_when_on_idle_brought_home_what_flew_and_nobody_goes_on(prevented: str) -> None:
    recording = in_flight()
    recording.status.timeout_at = 500.0
    recording.action(1, "goto", "succeeded", -27.603683, -48.518052, 40)
    alarm = Note(code="robot_unattended", text="in the air with nobody in charge", value=12.0)
    recording.health("uav1", "bridged", notes=(alarm,))
    recording.health("uav1", "bridged")
    recording.model.mind("uav", MindView(agent="uav", cycle=7))
    recording.health("uav", "agentd", idle=prevented != "intends something")
    recording.percept("state", "RTL", True, prevented == "armed")
    match prevented:
        case "the agent acts":
            recording.action(2, "set_mode", "accepted", "GUIDED")
            recording.action(2, "set_mode", "succeeded", "GUIDED")
        case "a client":
            recording.model.token(keys.alive("single-uav", "pilot", "client", "b1"), alive=True)
        case "on_idle: none":
            recording.status.setup.mission.robots["uav1"] = msgspec.structs.replace(
                recording.status.setup.mission.robots["uav1"], on_idle=NO_STEPS
            )
    looked = Looked(recording)
    assert looked.look() is None
    said = "uav1 was in the air without an agent in charge and was brought home (on_idle)"
    over = Ending(1, f"failed: {said}; no agent has anything left to do")
    assert looked.look(NOTHING_LEFT) == (None if prevented else over)


def test_a_lost_vehicle_is_not_down() -> None:
    recording = ordered("rtl")
    recording.percept("state", "", False, False)
    assert look(recording) is None


def test_an_order_is_told_once_whatever_else_it_ends() -> None:
    recording = ordered("rtl")
    recording.action(2, "takeoff", "refused", 5, by_operator="rtl")
    assert sum("the operator orders" in line for line in recording.lines) == 1


def test_the_header_tells_how_much_time_is_left() -> None:
    recording = in_flight()
    recording.status.timeout_at = 600.0
    assert ", timeout in 10 min" in screen(recording)[0]
    recording.at = 540.0
    assert ", timeout in 60 s" in screen(recording)[0]


def test_a_run_that_is_not_done_tells_its_last_errors_and_warnings_once_and_without_the_ending() -> None:
    recording = in_flight()
    for number in range(12):
        recording.status.journal.add("bridged uav1", f"problem {number}", "warning")
    recording.status.journal.add("bridged uav1", "problem 11", "warning")
    recording.status.journal.add("argosy", "failed: all is lost", "error")
    told = summary(recording.status, Ending(1, "failed: all is lost"), [("startup", 1.0)])
    assert "  last warnings\n" in told
    assert re.findall(r"problem (\d+)", told) == [str(number) for number in range(2, 12)]
    assert told.count("all is lost") == 1
    assert "last warnings" not in summary(recording.status, Ending(0, "done"), [("startup", 1.0)])


def test_a_run_ends_with_the_formulas_of_its_mission_and_says_what_the_agent_believes() -> None:
    recording = Recording()
    recording.mind("+!fly_mission")
    assert look(recording) is None
    recording.fail("altitude(0)[source(percept)]", 'mission_failed("Arm: low battery")[source(self)]')
    assert look(recording) == Ending(1, 'failed: uav believes mission_failed("Arm: low battery")')
    recording.mind(done=True)
    assert look(recording) == Ending(0, "done")
    assert recording.lines == ["uav: done: mission_done"]


def watching(restart: bool) -> tuple[Recording, Looked]:
    """Return a recording in which agent and router are there, and what may end its run."""
    recording = Recording(1.0)
    recording.at = 100.0
    recording.status.setup = replace(recording.status.setup, restart=restart)
    recording.model.token(keys.alive("single-uav", "uav", "agentd", "b1"), alive=True)
    recording.model.tick()
    return recording, Looked(recording)


@pytest.mark.parametrize("gone", [False, True])
def test_an_agent_that_is_silent_ends_the_run_unless_the_dead_are_started_again(gone: bool) -> None:
    for restart in (False, True):
        recording, looked = watching(restart)
        if gone:
            recording.model.token(keys.alive("single-uav", "uav", "agentd", "b1"), alive=False)
            recording.model.tick()
        recording.at += 4.0
        recording.model.mind_unanswered("uav")
        assert looked.look() is None
        recording.at += 2.0
        recording.model.mind_unanswered("uav")
        told = Ending(1, "failed: uav has not answered for 5 s")
        assert looked.look() == (None if restart else told)


@pytest.mark.parametrize(("gone", "router_up"), [(False, True), (True, True), (False, False)])
def test_a_bridge_that_hangs_ends_the_run_while_the_router_answers(gone: bool, router_up: bool) -> None:
    for restart in (False, True):
        recording, looked = watching(restart)
        token = keys.alive("single-uav", "uav1", "bridged", "b2")
        recording.model.token(token, alive=True)
        recording.health("uav1", "bridged")
        recording.model.tick()
        if gone:
            recording.model.token(token, alive=False)
            recording.model.tick()
        recording.at += 4.0
        recording.model.tick()
        assert looked.look() is None
        recording.at += 2.0
        recording.model.tick()
        recording.model.router_up, recording.model.router_since = (
            router_up,
            None if router_up else recording.model.now(),
        )
        told = Ending(1, "failed: the bridge of uav1 has published nothing for 5 s")
        assert looked.look() == (told if router_up and not restart else None)


def test_a_bridge_that_publishes_without_its_token_or_had_no_time_since_the_router_is_back_is_not_silent() -> None:
    recording, looked = watching(False)
    token = keys.alive("single-uav", "uav1", "bridged", "b2")
    for alive in (True, False):
        recording.model.token(token, alive=alive)
        recording.model.tick()
    recording.at += 6.0
    recording.health("uav1", "bridged")
    assert looked.look() is None
    recording.at += 6.0
    recording.model.router(up=False)
    recording.model.router(up=True)
    assert looked.look() is None
    recording.at += 6.0
    assert looked.look() is not None


def test_a_run_that_is_late_names_only_what_does_not_hold_and_robots_that_are_left_to_others() -> None:
    recording = in_flight()
    mission = recording.status.setup.mission
    (ended,) = mission.done
    both = replace(mission, done=(ended, replace(ended, formula="landed")), timeout=60.0)
    recording.status.setup = replace(recording.status.setup, mission=both)
    recording.mind(done=True)
    recording.status.timeout_at = 60.0
    recording.at = 61.0
    late = "failed: not done within 1min of mission time (12 s here); expected uav: landed"
    assert look(recording) == Ending(1, late)
    recording.percept("override", "LOITER")
    assert look(recording) == Ending(1, f"{late}; uav1 is left to others (pilot, failsafe), in LOITER")


def test_a_lost_router_ends_the_run_later_where_the_dead_are_started_again() -> None:
    for restart, patience in ((False, 10), (True, 45)):
        recording, looked = watching(restart)
        recording.model.router(up=False)
        recording.at += patience - 1
        assert looked.look() is None
        recording.at += 2
        told = f"failed: the router at tcp/127.0.0.1:7447 has not answered for {patience} s"
        assert looked.look() == Ending(1, told)


def test_what_an_agent_said_before_its_death_is_not_done() -> None:
    recording = in_flight()
    recording.mind(done=True)
    assert look(recording) == Ending(0, "done")
    recording.model.agents["uav"].forget()
    assert look(recording) is None
    recording.mind(done=True)
    assert look(recording) == Ending(0, "done")


def test_what_ran_on_a_bridge_that_died_has_ended_and_restarts_are_summed_up() -> None:
    recording = in_flight()
    recording.model.bridge_died("uav1")
    assert recording.model.actions.open() == []
    recording.status.restarts.update({"bridged uav1": 2, "agentd uav": 1})
    told = summary(recording.status, Ending(0, "done"), [("startup", 1.0)])
    assert "failed: its bridge died" in told
    assert "  restarts   bridged uav1 2, agentd uav 1\n" in told


def test_a_vehicle_whose_autopilot_is_not_commanded_ends_the_run_at_the_start() -> None:
    recording = Recording()
    said = "the autopilot of the vehicle is PX4"
    recording.health("uav1", "bridged", notes=(Note("another_code", said),))
    assert look(recording) is None, "programs read the code, not the words"
    recording.health("uav1", "bridged", notes=(Note("autopilot_unknown", said),))
    assert look(recording) == Ending(1, f"failed at the start: uav1: {said}")
