"""`argosy stop pause` and `continue` in flight, as an operator gives them: real processes throughout."""

from __future__ import annotations

import time
from pathlib import Path

from tests.argosy.conftest import Running, Start
from tests.support import forked


def stop(order: str, endpoint: str) -> tuple[int, str]:
    """Give an order from another terminal. Returns the exit code and what it said."""
    done = forked.run(["argosy", "stop", order, "--router", endpoint])
    return done.returncode, done.stdout + done.stderr


def daemons(endpoint: str) -> str:
    return forked.run(["argosy", "status", "--plain", "--router", endpoint]).stdout


def in_a_goto(start: Start, mission: Path) -> Running:
    """Return a run whose copter is under way to its waypoint."""
    running = start(mission, "--speed", "4", real_daemons=True)
    running.until("uav: goto(-27.603683,-48.518052,40)")
    return running


def test_a_mission_paused_in_flight_goes_on_to_its_place_and_is_done(
    start: Start, single_uav: Path, endpoint: str
) -> None:
    running = in_a_goto(start, single_uav)
    assert stop("pause", endpoint) == (0, "uav1: pause confirmed (the vehicle is in BRAKE)\n")
    running.until("uav1: paused by the operator; `argosy stop continue uav1` lets it go on")
    assert " paused=yes" in daemons(endpoint)
    time.sleep(3)  # 12 s of the mission: it must have been held, not only asked to hold
    assert "goto(-27.603683,-48.518052,40) succeeded" not in running.stdout
    assert stop("continue", endpoint) == (0, "uav1: continue confirmed (the vehicle is in GUIDED)\n")
    assert running.wait(120) == 0, running.stdout + running.stderr
    assert "uav: goto(-27.603683,-48.518052,40) succeeded after" in running.stdout
    assert "uav1: goes on: it is not paused any longer" in running.stdout
    assert "failed after" not in running.stdout.partition("paused by the operator")[2]


def test_continue_says_what_a_robot_is_that_is_not_paused(start: Start, single_uav: Path, endpoint: str) -> None:
    in_a_goto(start, single_uav)
    assert stop("continue", endpoint) == (0, "uav1: continue confirmed (it was not paused)\n")
    assert stop("hold", endpoint)[0] == 0
    said = "it is not paused: operator: hold; `release` gives it back to its agents"
    assert stop("continue", endpoint) == (1, f"uav1: continue NOT confirmed ({said})\n")


def test_a_robot_held_by_the_operator_stays_held_when_its_bridge_is_killed_and_started_again(
    start: Start, single_uav: Path, endpoint: str
) -> None:
    running = start(single_uav, "--speed", "4", "--restart", real_daemons=True)
    running.until("uav: goto(-27.603683,-48.518052,40)")
    assert stop("hold", endpoint) == (0, "uav1: hold confirmed (the vehicle is in BRAKE)\n")
    running.family["bridged serve"].kill()
    running.until("restart 1 in this run")
    running.until("up again after")
    running.until("operator: hold, as ordered before the bridge restarted: no action is accepted until `release`")
    assert "no action is accepted: operator: hold" in daemons(endpoint)
    assert stop("continue", endpoint)[1].startswith("uav1: continue NOT confirmed (it is not paused: operator: hold")
    code, said = stop("release", endpoint)
    assert (code, said.startswith("uav1: release confirmed (actions are accepted again")) == (0, True), said
    assert "no action is accepted" not in daemons(endpoint)
    assert running.wait(120) == 1, running.stdout + running.stderr
    assert "uav1: disarmed" in running.stdout
