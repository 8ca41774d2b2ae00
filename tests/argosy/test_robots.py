"""Missions of robots that are no vehicles, by the real daemons: a package's own driver, and a turtle."""

from __future__ import annotations

import re
import signal
import tomllib
from pathlib import Path

import pytest

from tests.argosy.conftest import MISSIONS, Running, Start
from tests.bridged.plugins import install

LAMP = MISSIONS.parent / "examples" / "lamp"


@pytest.fixture
def lamp(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Install the example package, for this process and those it starts, and return its mission."""
    site = tmp_path / "site"
    site.mkdir()
    project = tomllib.loads((LAMP / "pyproject.toml").read_text())["project"]
    modules = {path.stem: path.read_text() for path in LAMP.glob("*.py")}
    install(monkeypatch, site, modules, project["entry-points"], project["name"])
    monkeypatch.setenv("PYTHONPATH", str(site))
    return LAMP / "lamp.yaml"


def hurried(running: Running) -> int:
    """Wait for the end of a mission and leave out the measuring of idle use. Returns the exit code."""
    running.until("argosy: done")
    running.process.send_signal(signal.SIGINT)
    code = running.wait(20)
    assert running.left_running() == []
    return code


def test_a_robot_of_an_installed_driver_is_run_with_its_own_twin(start: Start, lamp: Path) -> None:
    running = start(lamp, real_daemons=True)
    assert hurried(running) == 0, running.stdout + running.stderr
    assert not any("bridged simulate" in line for line in running.family)
    assert re.search(r"keeper: lit at 70 %, 4[123] degrees", running.stdout)
    assert "level(70)" in running.stdout.rpartition("lamp1      ")[2]
    assert "defect" not in running.stdout


def test_without_the_package_the_mission_is_refused_with_what_there_is(start: Start) -> None:
    running = start(LAMP / "lamp.yaml", real_daemons=True)
    assert running.wait(60) == 2
    assert "lamp.toml:3: error: robot.driver: no driver `lamp`, there is mavlink, zenoh, python" in running.stderr
    assert running.stdout == ""


def test_a_turtle_is_simulated_and_draws_its_square(start: Start) -> None:
    running = start(MISSIONS / "turtle.yaml", "--speed", "10", real_daemons=True)
    assert hurried(running) == 0, running.stdout + running.stderr
    assert "simulator turtle: started" in running.stdout
    assert "turtle: done" in running.stdout
