"""The first mission, flown by the real daemons and the simulated copter, and what happens when one of them dies."""

import re
import signal
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.argosy.conftest import MISSIONS, Running, Start

LIMIT = 90.0
"""Memory of commd + bridged + agentd together in flight, MB of PSS."""


def flown(running: Running, seconds: float = 240) -> tuple[int, str, str]:
    """Wait for the end. Returns exit code, stdout, stderr; nothing may be left running."""
    code = running.wait(seconds)
    assert running.left_running() == []
    return code, running.stdout, running.stderr


def test_the_mission_is_flown_to_its_end(start: Start, single_uav: Path, tmp_path: Path) -> None:
    report = tmp_path / "report"
    running = start(single_uav, "--speed", "10", "--report", str(report), real_daemons=True)
    running.until("agentd uav: up")
    code, out, err = flown(running)
    assert code == 0, out + err
    for action in ('set_mode("GUIDED")', "arm_motors(true)", "takeoff(5)", "goto(-27.603683,-48.518052,40)"):
        assert re.search(rf"uav: {re.escape(action)} succeeded after", out), action
    assert "uav: return_to_launch succeeded after" in out
    assert "uav: mission done" in out
    assert "single-uav: done" in out
    left = re.search(r"uav1 +RTL, disarmed, (-?[\d.]+) m above home; flew (\d+) m, ([\d.]+) m high", out)
    assert abs(float(left[1])) < 0.5
    assert 95 < float(left[2]) < 125  # there and back over 49.6 m
    assert 39 < float(left[3]) < 42
    memory = re.search(r"memory +([\d.]+) MB at most", out)
    assert float(memory[1]) < LIMIT
    assert re.search(r"idle +[\d.]+ % of a core", out)
    ElementTree.parse(report / "track.svg")
    assert "uav: mission done" in (report / "mission.log").read_text()


@pytest.mark.parametrize("victim", ["commd", "bridged uav1", "agentd uav"])
def test_a_daemon_killed_in_flight_fails_the_mission_and_the_vehicle_comes_home(
    start: Start, single_uav: Path, victim: str
) -> None:
    running = start(single_uav, "--speed", "10", real_daemons=True)
    running.until("uav: takeoff(5) succeeded")
    running.family[f"{victim.split()[0]} serve"].kill()
    code, out, err = flown(running)
    assert code == 1
    assert err == f"error: failed: {victim} was killed by SIGKILL\n"
    assert f"argosy: failed: {victim} was killed by SIGKILL; vehicles are armed: their programs have 10 wall" in out
    assert re.search(r"uav1 +RTL, disarmed, -?0\.\d m above home", out), out


def test_a_bridge_killed_while_it_brings_its_vehicle_home_is_restarted_for_that(start: Start, single_uav: Path) -> None:
    running = start(single_uav, "--speed", "5", real_daemons=True)
    running.until("uav: takeoff(5) succeeded")
    running.process.send_signal(signal.SIGINT)
    running.until("rtl (the bridge stops: rtl): succeeded")
    running.family["bridged serve"].kill()
    code, out, err = flown(running)
    assert (code, err) == (130, "error: stopped by ctrl-C\n")
    assert "bridged uav1: restarted, pid" in out
    assert re.search(r"uav1 +RTL, disarmed, -?0\.\d m above home", out), out


def test_a_bridge_that_stands_still_for_less_than_the_grace_does_not_end_a_mission_whose_program_goes_on(
    start: Start, single_uav: Path, tmp_path: Path
) -> None:
    program = (MISSIONS / "single_uav" / "uav.asl").read_text()
    again = """
+state(_, true, true) : mission_failed(_) & waypoint(Lat, Long, Height)
  <- .abolish(mission_failed(_)); set_mode("GUIDED"); goto(Lat, Long, Height); !home_again; +mission_done.
"""
    passing = "unreachable, restart, busy"
    assert passing in program
    gives_up = program[: program.index("// The bridge was lost in flight")].replace(passing, "busy")
    (tmp_path / "uav.asl").write_text(gives_up + again)
    text = single_uav.read_text().replace(str(MISSIONS / "single_uav" / "uav.asl"), "uav.asl")
    single_uav.write_text(text)
    running = start(single_uav, "--speed", "5", real_daemons=True)
    running.until("uav: goto(-27.603683,-48.518052,40)")
    bridge = running.family["bridged serve"]
    bridge.suspend()
    running.until("uav believes mission_failed")
    bridge.resume()
    code, out, err = flown(running)
    assert (code, err) == (0, ""), out
    assert "argosy: the mission goes on" in out
    assert re.search(r"uav1 +RTL, disarmed", out)


def test_ctrl_c_in_flight_brings_the_vehicle_home_and_again_leaves_it_there(start: Start, single_uav: Path) -> None:
    running = start(single_uav, "--speed", "5", real_daemons=True)
    running.until("uav: takeoff(5) succeeded")
    running.process.send_signal(signal.SIGINT)
    running.until("rtl (the bridge stops: rtl): succeeded")
    running.process.send_signal(signal.SIGINT)
    code, out, _ = flown(running, 20)
    assert code == 130
    assert "argosy: hurrying" in out
    assert "uav1: mode RTL" in out
    told = "uav1 WAS STILL IN THE AIR: RTL confirmed by its bridge; it is simulated and ended with the run"
    assert out.splitlines()[-1] == told


def test_two_missions_with_open_links_fly_at_once(start: Start, single_uav: Path, free_port: Callable[[], int]) -> None:
    lines = [line for line in single_uav.read_text().splitlines() if not line.startswith("    link:")]
    single_uav.write_text("\n".join(lines))
    other = f"tcp/127.0.0.1:{free_port()}"
    runs = [start(single_uav, "--speed", "10", *more, real_daemons=True) for more in ((), ("--router", other))]
    for running in runs:
        running.until("uav: takeoff(5) succeeded")
        running.process.send_signal(signal.SIGINT)
    for running in runs:
        code, out, _ = flown(running)
        assert code == 130
        assert re.search(r"uav1 +RTL, disarmed", out)
