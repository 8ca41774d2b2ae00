"""The picture of a flown track, drawn from a recording."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from argosy.report import Flown, draw, write_report
from argosy.svg import Frame, equal_frame, number, ticks
from argosy.track import Track, metres
from tests.argosy.recorded import AWAY, HOME, Recording, flight

SVG = "{http://www.w3.org/2000/svg}"


def drawn(recording: Recording) -> ElementTree.Element:
    """Draw a recording and read the picture back."""
    tracks = {name: robot.track for name, robot in recording.picture.robots.items()}
    text = draw(Flown("single-uav", tracks, list(recording.picture.actions.values()), recording.at))
    return ElementTree.fromstring(text)


def lines_of(root: ElementTree.Element) -> list[list[tuple[float, float]]]:
    """Return the points of each polyline."""
    found = [line.get("points", "").split() for line in root.iter(f"{SVG}polyline")]
    return [[(float(x), float(y)) for x, y in (point.split(",") for point in points)] for points in found]


def texts_of(root: ElementTree.Element) -> list[str]:
    """Return every text in the picture."""
    return [text.text or "" for text in root.iter(f"{SVG}text")]


def test_the_plan_shows_the_waypoint_where_the_track_turns_and_home_where_it_ends() -> None:
    root = drawn(flight())
    plan, profile = lines_of(root)
    _, diamond = (path.get("d", "") for path in root.iter(f"{SVG}path"))  # the first one stands in the legend
    x, y = map(float, re.findall(r"[\d.]+", diamond)[:2])
    assert (x, y + 7) in [pytest.approx(point, abs=0.2) for point in plan]
    assert plan[0] == pytest.approx(plan[-1], abs=0.5)
    top = min(height for _, height in profile)
    assert profile[0][1] > top + 100  # it climbs


def test_both_axes_of_the_plan_have_one_scale() -> None:
    plan, _ = lines_of(drawn(flight()))
    (x0, y0), (x1, y1) = plan[0], min(plan, key=lambda point: point[1])
    east, north = metres(AWAY, HOME)
    assert (x1 - x0) / east == pytest.approx((y0 - y1) / north, rel=0.01)


def test_axes_have_units_and_modes_and_actions_their_names() -> None:
    texts = texts_of(drawn(flight()))
    for wanted in ("m east of home", "m north of home", "m above home", "s of mission", "GUIDED", "RTL", "40 m"):
        assert wanted in texts
    assert "arm_motors(true) failed" in texts
    assert "return_to_launch running" in texts


def test_a_flight_without_a_position_is_said_in_words() -> None:
    assert "no position was seen" in texts_of(drawn(Recording()))


def test_names_from_outside_cannot_break_the_picture() -> None:
    recording = flight()
    recording.percept("state", "<script>&\x00\"'", True, True)
    recording.action(9, "say", "refused", "</svg>")
    drawn(recording)


def test_a_vehicle_that_never_moved_still_has_a_picture() -> None:
    track = Track(home=HOME)
    for second in range(5):
        track.moved(float(second), *HOME)
    ElementTree.fromstring(draw(Flown("still", {"uav1": track}, [], 5.0)))


def test_the_report_holds_picture_and_summary(tmp_path: Path) -> None:
    write_report(tmp_path, flight().status, "all is well\n", 60.0)
    assert (tmp_path / "summary.txt").read_text() == "all is well\n"
    ElementTree.parse(tmp_path / "track.svg")


@pytest.mark.parametrize(
    ("low", "high", "wanted", "found"),
    [
        (0, 10, 5, [0, 2, 4, 6, 8, 10]),
        (-3, 3, 3, [-2, 0, 2]),
        (0, 0.3, 3, [0, 0.1, 0.2, 0.3]),
        (95, 1_010, 4, [500, 1000]),
    ],
)
def test_ticks_are_round_values(low: float, high: float, wanted: float, found: list[float]) -> None:
    assert ticks(low, high, wanted) == pytest.approx(found)
    assert number(-0.1 - 0.2) == "−0.3"


def test_a_frame_puts_values_where_they_belong() -> None:
    frame = Frame(10, 20, 100, 50, (0, 10), (0, 5))
    assert frame.at(0, 0) == (10, 70)
    assert frame.at(10, 5) == (110, 20)
    square = equal_frame(0, 0, 200, 100, [(0, 0), (0, 0)])
    assert square.x_range[1] - square.x_range[0] == pytest.approx(2 * (square.y_range[1] - square.y_range[0]))
