"""The first mission, flown by the real daemons and the simulated copter, and what happens when one of them dies."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from tests.argosy.conftest import Running, Start
from tests.support.promises import least

LIMIT = 90.0
"""Memory of commd + bridged + agentd together in flight, MB of PSS."""


def flown(running: Running, seconds: float = 240) -> tuple[int, str, str]:
    """Wait for the end. Returns exit code, stdout, stderr; nothing may be left running."""
    code = running.wait(seconds)
    assert running.left_running() == []
    return code, running.stdout, running.stderr


def test_the_mission_is_flown_to_its_end(start: Start, single_uav: Path, tmp_path: Path) -> None:
    report = tmp_path / "report"
    running = start(single_uav, "--speed", "20", "--report", str(report), real_daemons=True)
    running.until("agentd uav: up")
    code, out, err = flown(running)
    assert code == 0, out + err
    for action in ('set_mode("GUIDED")', "arm_motors(true)", "takeoff(5)", "goto(-27.603683,-48.518052,40)"):
        assert re.search(rf"uav: {re.escape(action)} succeeded after", out), action
    assert "uav: return_to_launch succeeded after" in out
    assert "uav: mission done" in out
    assert "single-uav: done" in out
    left = re.search(r"uav1 +RTL, disarmed, (-?[\d.]+) m above home; flew (\d+) m, ([\d.]+) m high", out)
    assert left is not None
    assert abs(float(left[1])) < 0.5
    assert 95 < float(left[2]) < 125  # there and back over 49.6 m
    assert 39 < float(left[3]) < 42
    memory = re.search(r"memory +([\d.]+) MB at most", out)
    assert memory is not None
    assert float(memory[1]) < LIMIT
    assert re.search(r"idle +[\d.]+ % of a core", out)
    ElementTree.parse(report / "track.svg")
    assert "uav: mission done" in (report / "mission.log").read_text()


def test_three_copters_on_one_link_are_flown_by_one_bridge(start: Start, three_uavs: Path, tmp_path: Path) -> None:
    running = start(three_uavs, "--speed", "20", "--report", str(tmp_path / "report"), real_daemons=True)
    running.until("argosy: done", 60)
    running.process.send_signal(signal.SIGINT)  # there is no need to measure idle use
    assert sum("bridged serve" in line for line in running.family) == 2  # by its kind and by its command line: one
    code, out, err = flown(running, 60)
    assert code == 0, out + err
    assert "bridged uav1 uav2 uav3: up" in out
    for agent, height in (("uav_a", 10), ("uav_b", 15), ("uav_c", 20)):
        assert re.search(rf"{agent}: takeoff\({height}\) succeeded after", out)
        assert re.search(rf"{agent}: return_to_launch succeeded after", out)
    for robot, height in (("uav1", 15), ("uav2", 15), ("uav3", 20)):  # a copter returns at 15 m at least
        left = re.search(rf"{robot} +RTL, disarmed, (-?[\d.]+) m above home; flew (\d+) m, ([\d.]+) m high", out)
        assert left is not None, out
        assert 70 < float(left[2]) < 100  # there and back over 40 m
        assert abs(float(left[3]) - height) < 2
    drawn = "".join(ElementTree.parse(tmp_path / "report" / "track.svg").getroot().itertext())
    assert all(f"{robot}: " in drawn for robot in ("uav1", "uav2", "uav3"))


@pytest.mark.parametrize("victim", ["commd serve", "bridged simulate", "bridged serve", "agentd serve"])
def test_any_process_killed_in_flight_ends_the_run_within_5_s_and_is_named(
    start: Start, single_uav: Path, victim: str
) -> None:
    def ending() -> float:
        running = start(single_uav, "--speed", "10", real_daemons=True)
        running.until("uav: takeoff(5) succeeded")
        running.family[victim].kill()
        killed = time.monotonic()
        code, out, err = flown(running)
        took = time.monotonic() - killed
        name = {"commd serve": "commd", "bridged simulate": "simulator uav1", "bridged serve": "bridged uav1"}
        assert code == 1
        assert f"error: failed: {name.get(victim, 'agentd uav')} was killed by SIGKILL" in err, out + err
        return took

    assert least(ending, 5.0) < 5.0


def test_ctrl_c_in_flight_leaves_the_vehicle_returning_home(start: Start, single_uav: Path) -> None:
    running = start(single_uav, "--speed", "5", real_daemons=True)
    running.until("uav: takeoff(5) succeeded")
    running.process.send_signal(signal.SIGINT)
    code, out, _ = flown(running)
    assert code == 130
    assert "uav1: is armed: its bridge is to order rtl (on_shutdown)" in out
    assert "uav1: mode RTL" in out
    assert re.search(r"uav1 +RTL, armed", out)


def test_an_operator_stops_the_vehicle_from_another_terminal(start: Start, single_uav: Path, endpoint: str) -> None:
    running = start(single_uav, "--speed", "5", real_daemons=True)
    running.until("uav: takeoff(5) succeeded")
    stop = [sys.executable, "-m", "argosy", "stop", "land", "--router", endpoint]
    stopped = subprocess.run(stop, capture_output=True, text=True, timeout=60, check=False)
    assert stopped.returncode == 0, stopped.stderr
    assert stopped.stdout.startswith("uav1: land confirmed")
    code, out, err = flown(running)
    assert code == 1
    assert "uav1: the operator orders land" in out
    assert "uav1: mode LAND" in out
    assert "error: stopped by the operator: land" in err
    assert re.search(r"uav1 +LAND, disarmed", out)


def test_nothing_is_left_when_argosy_itself_is_killed_in_flight(start: Start, single_uav: Path) -> None:
    running = start(single_uav, "--speed", "10", real_daemons=True)
    running.until("uav: takeoff(5) succeeded")
    running.process.send_signal(signal.SIGKILL)
    running.process.wait(10)
    assert running.left_running() == []
