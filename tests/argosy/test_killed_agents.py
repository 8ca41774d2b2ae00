"""Shipped missions whose agents are killed in flight and started again: no vehicle is left in the air by itself.

Real processes: `argosy run MISSION --restart`, and `kill -9` of its agentd.
"""

from __future__ import annotations

import re
import shutil
import time
from pathlib import Path

import pytest

from tests.argosy.conftest import MISSIONS, Running, Start, copied
from tests.support.ports import free_port

BOUND = 120.0
"""Wall seconds from a kill to the ground at most."""


def shipped(name: str, folder: Path, without: str = "", program: str = "") -> Path:
    """Copy a mission with its folder: its program without the lines that begin with a text, or another program."""
    mission = copied(name, folder, free_port())
    shutil.copytree(MISSIONS / name, folder / name)
    mission.write_text(mission.read_text().replace(f"{MISSIONS / name}", name))
    for path in (folder / name).glob("*.asl") if without or program else ():
        kept = [line for line in path.read_text().splitlines() if not (without and line.startswith(without))]
        path.write_text(program or "\n".join(kept))
    return mission


def restarting(start: Start, mission: Path) -> Running:
    """Fly a mission whose daemons are started again."""
    return start(mission, "--restart", "--plain", "--speed", "10", real_daemons=True)


def kill_agents(running: Running, when: str) -> None:
    """Kill the agents' daemon as soon as the run has printed something."""
    running.until(when)
    running.family["agentd serve"].kill()


def until_down(running: Running, *robots: str) -> None:
    """Wait until each robot was disarmed after it was armed last."""
    end = time.monotonic() + BOUND
    while True:
        out = running.stdout
        down = [out.rfind(f"{robot}: disarmed") > out.rfind(f"{robot}: armed") >= 0 for robot in robots]
        if all(down):
            return
        assert time.monotonic() < end, out + running.stderr
        time.sleep(0.1)


def modes(running: Running, robot: str, after: str) -> list[str]:
    """The modes that a robot was in after a line."""
    return re.findall(rf"{robot}: mode (\w+)", running.stdout.partition(after)[2])


@pytest.mark.parametrize(
    ("name", "when", "end"),
    [
        ("single_uav", "uav: taking off", "single-uav: done"),
        ("single_uav", "uav: flying to", "single-uav: done"),
        ("single_uav", "uav: returning to home", "single-uav: done"),
        ("three_uavs", "uav_a: hopping", "three-uavs: done"),
        ("paper_uav", "uav: returning to home", "paper-uav: failed: uav believes mission_failed"),
        ("turtle", "artist: to 8, 8", "turtle: done"),
        ("paper_turtle", "walker: cmd_vel(1.5", "paper-turtle: done"),
    ],
)
def test_a_shipped_mission_comes_to_an_end_of_its_own_on_the_ground_when_its_agents_are_killed(
    start: Start, tmp_path: Path, name: str, when: str, end: str
) -> None:
    running = restarting(start, shipped(name, tmp_path))
    kill_agents(running, when)
    if "turtle" not in name:
        until_down(running, *(("uav1", "uav2", "uav3") if name == "three_uavs" else ("uav1",)))
    running.wait(BOUND)
    out = running.stdout + running.stderr
    assert "was killed by SIGKILL; it is started again" in out
    assert end in out
    assert "not done within" not in out


def test_a_copter_on_its_way_home_is_not_held_up_by_the_death_of_its_agent(start: Start, tmp_path: Path) -> None:
    """The paper's programs have no plan for `+restarted(N)`: the agent is back and does nothing."""
    running = restarting(start, shipped("single_uav", tmp_path, without="+restarted"))
    running.until("uav: returning to home")
    kill_agents(running, "uav1: mode RTL")
    until_down(running, "uav1")
    assert modes(running, "uav1", "it is started again") == []


@pytest.mark.parametrize("when", ["uav: taking off", "uav: flying to"])
def test_a_copter_that_is_held_for_a_dead_agent_comes_home_when_that_is_back_and_commands_nothing(
    start: Start, tmp_path: Path, when: str
) -> None:
    running = restarting(start, shipped("single_uav", tmp_path, without="+restarted"))
    kill_agents(running, when)
    until_down(running, "uav1")
    assert "RTL" in modes(running, "uav1", "it is started again")


def test_a_copter_whose_agent_has_nothing_in_mind_comes_home_and_the_run_says_why(start: Start, tmp_path: Path) -> None:
    up = '!up. +!up <- .wait(bridge(up)); set_mode("GUIDED"); arm_motors(true); takeoff(5); .print(up).'
    mission = shipped("single_uav", tmp_path, program=up)
    running = start(mission, "--plain", "--speed", "10", real_daemons=True)
    running.until("uav1: in the air without anybody in charge: agent uav is there and intends nothing")
    until_down(running, "uav1")
    assert modes(running, "uav1", "takeoff(5) succeeded") == ["RTL"]
