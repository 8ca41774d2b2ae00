"""`argosy stop pause` and `continue` in flight, as an operator gives them: real processes throughout."""

from pathlib import Path

from tests.argosy.conftest import Start
from tests.support import forked


def stop(order: str, endpoint: str) -> tuple[int, str]:
    """Give an order from another terminal. Returns the exit code and what it said."""
    done = forked.run(["argosy", "stop", order, "--router", endpoint])
    return done.returncode, done.stdout + done.stderr


def daemons(endpoint: str) -> str:
    return forked.run(["argosy", "status", "--plain", "--router", endpoint]).stdout


def test_a_mission_paused_in_flight_goes_on_and_is_done(start: Start, single_uav: Path, endpoint: str) -> None:
    running = start(single_uav, "--speed", "5", real_daemons=True)
    running.until("uav: goto(-27.603683,-48.518052,40)")
    assert stop("pause", endpoint) == (0, "uav1: pause confirmed (the vehicle is in BRAKE)\n")
    running.until("uav1: paused by the operator; `argosy stop continue uav1` lets it go on")
    assert " paused=yes" in daemons(endpoint)
    assert stop("continue", endpoint) == (0, "uav1: continue confirmed (the vehicle is in GUIDED)\n")
    assert running.wait(120) == 0, running.stdout + running.stderr
    assert "uav: goto(-27.603683,-48.518052,40) succeeded after" in running.stdout
    assert "uav1: goes on: no longer paused" in running.stdout
    assert "failed after" not in running.stdout.partition("paused by the operator")[2]
