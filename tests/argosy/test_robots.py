"""Missions of robots that are no vehicles, by the real daemons, with a package's own driver."""

import re
import signal
import tomllib
from pathlib import Path

import pytest

from tests.argosy.conftest import MISSIONS, Running, Start
from tests.bridged.plugins import install

PAGE = MISSIONS.parent / "docs/guides/drivers.md"
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
    code = running.wait()
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
    assert running.wait() == 2
    assert "lamp.toml:3: error: robot.driver: no driver `lamp`, there is mavlink, zenoh, python" in running.stderr
    assert running.stdout == ""


def written(folder: Path) -> Path:
    """Write the files of the page, those that begin with their name, as a reader would. Returns the folder."""
    for name, text in re.findall(r"^```\w+\n((?:#|//) \S+\n)(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL):
        path = folder / name.split()[1]
        path.parent.mkdir(exist_ok=True)
        path.write_text(name + text)
    return folder


def test_the_counter_of_the_page_is_a_driver(start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, site = written(tmp_path), tmp_path / "site"
    site.mkdir()
    project = tomllib.loads((folder / "counter" / "pyproject.toml").read_text())["project"]
    modules = {"counter_driver": (folder / "counter" / "counter_driver.py").read_text()}
    install(monkeypatch, site, modules, project["entry-points"], project["name"])
    monkeypatch.setenv("PYTHONPATH", str(site))
    running = start(folder / "counting.yaml", real_daemons=True)
    assert hurried(running) == 0, running.stdout + running.stderr


def test_who_is_asked_about_a_robot_that_is_no_vehicle_is_asked_about_a_robot(start: Start, tmp_path: Path) -> None:
    running = start(written(tmp_path) / "heating.yaml", real_daemons=True)
    assert running.wait() == 2
    asked = "error: this would act on the real robot room; there is no terminal to ask at: confirm by --yes\n"
    assert running.stderr == asked
