"""The live view: its content at several sizes, and drawn in a real terminal."""

import asyncio
import io
import re
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest
from rich.console import Console

from argosy.processes.process_table import Kind, Process
from argosy.processes.supervisor import Child
from argosy.run.screen import Screen
from schemas.wire.records import ActionStatus
from tests.argosy.conftest import DOUBLES
from tests.argosy.recorded import Recording, flight
from tests.argosy.watch.terminal import Terminal

_ESCAPES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]|\x1b[=>]")


def screen(recording: Recording, width: int = 80, height: int = 24) -> list[str]:
    """Return the lines of the view on a terminal of this size."""
    console = Console(width=width, height=height, file=io.StringIO(), legacy_windows=False)
    options = console.options.update(width=width, height=height)
    segments = list(console.render(Screen(recording.status), options))
    return "".join(segment.text for segment in segments).splitlines()


def in_flight() -> Recording:
    """A recording that stops in the middle of the way."""
    recording = Recording()
    recording.percept("state", "GUIDED", True, True)
    recording.percept("home_pos", -27.604033, -48.518363)
    recording.percept("altitude", 38.24)
    recording.percept("global_pos", -27.6037, -48.5181)
    recording.action(1, "goto", "running", -27.603683, -48.518052, 40)
    recording.at = 12.0
    recording.mind("+!visited(-27.603683,-48.518052,40)", "+!fly_mission")
    recording.model.agents["uav"].prints.append("flying to the waypoint")
    return recording


def test_the_view_shows_vehicle_intentions_actions_prints_and_progress() -> None:
    text = "\n".join(screen(in_flight()))
    assert "uav1  GUIDED  armed   38.2 m up    45 m off home  -27.603700 -48.518100" in text
    assert "uav  +!visited(-27.603683,-48.518052,40) ‹ +!fly_mission  uav.asl:41" in text
    assert "▸ goto(-27.603683,-48.518052,40)  running 12 s" in text
    assert "“flying to the waypoint”" in text
    assert "done when  ○ uav: mission_done   0 of 1" in text
    assert "12 s of mission, 2 s here, x5" in text


def test_a_run_whose_vehicle_is_on_the_ground_is_not_shown_as_flying() -> None:
    recording = in_flight()
    recording.percept("state", "GUIDED", True, False)
    head = screen(recording)[0]
    assert "running" in head
    assert "flying" not in head


def test_a_lost_vehicle_keeps_its_last_known_state_and_old_data_tells_its_age() -> None:
    recording = in_flight()
    recording.at = 40.0
    assert "uav1 40 s ago:  GUIDED  armed" in "\n".join(screen(recording, 100))
    recording.health("uav1", "bridged")
    assert "uav1  GUIDED  armed" in "\n".join(screen(recording, 100))
    recording.percept("state", "", False, False)
    text = "\n".join(screen(recording, 100))
    assert "uav1  LOST, last heard 40 s ago: armed, GUIDED, 38 m up at -27.603700, -48.518100" in text


def test_a_robot_that_is_no_vehicle_shows_its_percepts() -> None:
    recording = Recording()
    recording.percept("pose", 5.5, 5.5, 0)
    recording.percept("color", 1, 2, 3)
    recording.percept("pose", 6.5, 5.5, 0)
    text = "\n".join(screen(recording))
    assert "uav1  pose(6.5,5.5,0)  color(1,2,3)" in text
    assert max(map(len, screen(recording, 20))) <= 20


def test_figures_of_an_action_are_left_out_rather_than_cut() -> None:
    recording = in_flight()
    feedback = {"distance": 12.5, "altitude": 38.2, "speed": 4.9}
    status = ActionStatus(id="uav:1:1", state="running", name="goto", feedback=feedback)
    recording.model.status("argosy/single-uav/uav/status/goto", status)
    for width in range(60, 110):
        (line,) = [line for line in screen(recording, width) if "▸ goto" in line]
        shown = line.partition(" s  ")[2]
        assert re.fullmatch(r"(distance 12\.5)?(  altitude 38\.2)?(  speed 4\.9)?( ?…)? *", shown), shown
    assert "speed 4.9" in shown


@pytest.mark.parametrize(("width", "height"), [(80, 24), (40, 10), (132, 50), (200, 12)])
def test_the_view_fits_its_terminal(width: int, height: int) -> None:
    recording = in_flight()
    for number in range(100):
        recording.status.journal.add("commd", f"line {number} of many that are all quite long " * 3)
    lines = screen(recording, width, height)
    assert len(lines) < height
    assert max(map(len, lines)) <= width
    if height > 12:
        assert "line 99" in lines[-1]


def test_what_was_done_shows_as_done() -> None:
    recording = flight()
    recording.mind(done=True)
    text = "\n".join(screen(recording))
    assert "● uav: mission_done   1 of 1" in text
    assert "no intentions" in text or "not there yet" in text


def test_in_a_real_terminal_the_view_is_drawn_and_the_summary_stays(single_uav: Path, endpoint: str) -> None:
    run = [str(DOUBLES), "run", str(single_uav), "--router", endpoint, "--speed", "5"]
    with Terminal(run, columns=100, lines=30) as terminal:
        assert terminal.end() == 0
    drawn, _, rest = terminal.output.decode().rpartition("\x1b[?1049l")  # the other screen closes here
    text = _ESCAPES.sub("", drawn)
    assert "\x1b[?1049h" in drawn
    assert "▸ goto(-27.603683,-48.518052,40)" in text
    assert "● bridged uav1" in text
    assert "single-uav: done" in rest
    assert "single-uav: done" not in text


def test_the_view_shows_what_was_restarted_and_what_is_to_be() -> None:
    recording = in_flight()
    kind = Kind("agentd", lambda setup: [], lambda setup, subject: [])
    for name, replaced in (("uav", False), ("other", True)):
        process = Process(kind, "uav", (), label=name)
        child = Child(process, cast("asyncio.subprocess.Process", SimpleNamespace(pid=4711, returncode=-9)))
        child.replaced, child.died = replaced, 1.0 if replaced else None
        recording.status.children.append(child)
    recording.status.restarts["agentd uav"] = 3
    text = "\n".join(screen(recording, height=40))
    assert re.search(r"○ agentd uav +pid 4711 +coming up, restarted 3 times", text)
    assert re.search(r"○ agentd other +pid 4711 +died, is started again", text)
