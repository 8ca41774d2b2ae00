"""The report of a run: the picture of the flown track, and the summary beside the log."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from argosy.seen import ActionSeen
from argosy.status import Status
from argosy.svg import FAINT, INK, PAPER, Frame, Svg, equal_frame
from argosy.track import Point, Track, metres
from schemas.terms import to_float

COLOURS = ("#0969da", "#bc4c00", "#1a7f37", "#8250df", "#0b7285", "#bf3989")
"""One for each robot, in order; then from the first again."""
OUTCOMES = {"succeeded": "#2da44e", "failed": "#cf222e", "refused": "#cf222e", "timed_out": "#cf222e"}
MODE_SHADES = ("#f3f7fc", "#fdf6ec", "#f1f8f2", "#f7f2fc")
WIDTH, MARGIN = 960.0, 64.0
LINE = 16.0
"""Pixels between two lines below the title."""
LANE, MAX_LANES = 20.0, 30
"""Pixels of one line of actions, and how many lines there are at most."""


@dataclass(frozen=True)
class Flown:
    """What the picture shows."""

    mission: str
    tracks: dict[str, Track]
    """By robot."""
    actions: list[ActionSeen]
    until: float
    """Mission seconds at the end."""


def write_report(folder: Path, status: Status, text: str, until: float) -> None:
    """Write `track.svg` and `summary.txt`; `until` is the mission time at which the mission ended. Raises OSError."""
    tracks = {name: robot.track for name, robot in status.picture.robots.items()}
    flown = Flown(status.setup.mission.name, tracks, list(status.picture.actions.values()), until)
    (folder / "summary.txt").write_text(text, encoding="utf-8")
    (folder / "track.svg").write_text(draw(flown), encoding="utf-8")


def draw(flown: Flown) -> str:
    """Return the picture: the plan view, and below it altitude, modes and actions over mission time."""
    lanes = _lanes(flown.actions)
    rows = max(lanes.values(), default=-1) + 1
    told = _subtitles(flown.tracks)
    top = LINE * max(0, len(told) - 1)
    svg = Svg(WIDTH, 920 + top + rows * LANE, f"{flown.mission}: flown track")
    svg.add("rect", width=svg.width, height=svg.height, fill=PAPER)
    svg.text(MARGIN, 40, flown.mission, 20, font_weight="600")
    for index, line in enumerate(told):
        svg.text(MARGIN, 60 + LINE * index, line, 12, FAINT)
    origin = _origin(flown.tracks.values())
    if origin is None:
        svg.text(MARGIN, 100 + top, "no position was seen", 14)
        return str(svg)
    _legend(svg, flown)
    _plan(svg, flown, origin, top)
    _profile(svg, flown, lanes, top)
    return str(svg)


def _subtitles(tracks: dict[str, Track]) -> list[str]:
    told = []
    for name, track in tracks.items():
        highest = track.highest()
        high = "" if highest is None else f", {highest:.1f} m above home at most"
        told.append(f"{name}: {track.length():.0f} m over ground{high}")
    return told


def _origin(tracks: Iterable[Track]) -> tuple[float, float] | None:
    for track in tracks:
        if track.home is not None:
            return track.home
        if track.points:
            return track.points[0].latitude, track.points[0].longitude
    return None


def _colours(flown: Flown) -> dict[str, str]:
    return {name: COLOURS[index % len(COLOURS)] for index, name in enumerate(flown.tracks)}


def _legend(svg: Svg, flown: Flown) -> None:
    x, y = WIDTH - MARGIN, 40.0
    items = [(name, colour) for name, colour in _colours(flown).items()]
    for text, colour in reversed([*items, ("home", ""), ("target", "target")]):
        x -= 8.0 * len(text)
        svg.text(x, y, text, 12)
        if colour == "target":
            _diamond(svg, x - 14, y - 4)
        elif colour:
            svg.line(x - 26, y - 4, x - 6, y - 4, colour, stroke_width=2.5)
        else:
            _home(svg, x - 14, y - 4)
        x -= 44 if colour not in ("", "target") else 38


def _plan(svg: Svg, flown: Flown, origin: tuple[float, float], top: float) -> None:
    """The plan view: metres east and north of home, both axes to one scale."""
    paths = {
        name: [metres((point.latitude, point.longitude), origin) for point in _flight(track)]
        for name, track in flown.tracks.items()
    }
    targets = {target: metres(target[:2], origin) for target in _targets(flown.actions)}
    points = [(0.0, 0.0), *targets.values(), *(place for path in paths.values() for place in path)]
    frame = equal_frame(MARGIN, 100 + top, WIDTH - 2 * MARGIN, 460, points)
    frame.draw_axes(svg, "m east of home", "m north of home")
    for name, path in paths.items():
        svg.polyline([frame.at(*place) for place in path], _colours(flown)[name], stroke_width=2.2)
    for (_, _, altitude), place in targets.items():
        x, y = frame.at(*place)
        _diamond(svg, x, y)
        svg.text(x + 11, y - 7, f"{altitude:g} m", 12, INK)
    for name, path in paths.items():
        if path:
            x, y = frame.at(*path[-1])
            svg.add("circle", cx=x, cy=y, r=4, fill=_colours(flown)[name])
    for track in flown.tracks.values():
        if track.home is not None:
            _home(svg, *frame.at(*metres(track.home, origin)))


def _profile(svg: Svg, flown: Flown, lanes: dict[str, int], top: float) -> None:
    """Altitude over mission time, the modes behind it if there is one robot, the actions below it."""
    heights = [altitude for track in flown.tracks.values() for _, altitude in track.heights]
    high, low = max([*heights, 5.0]) * 1.18, min([*heights, 0.0])
    times = (0.0, max(flown.until, 1.0))
    frame = Frame(MARGIN, 660 + top, WIDTH - 2 * MARGIN, 190, times, (low - high * 0.02, high))
    if len(flown.tracks) == 1:
        _modes(svg, frame, next(iter(flown.tracks.values())), flown.until)
    frame.draw_axes(svg, "s of mission", "m above home")
    for name, track in flown.tracks.items():
        line = [frame.at(at, altitude) for at, altitude in track.heights if at <= frame.x_range[1]]
        svg.polyline(line, _colours(flown)[name], stroke_width=2)
    agents = {action.agent for action in flown.actions}
    for action in flown.actions:
        if action.id in lanes:
            text = action.text if len(agents) == 1 else f"{action.agent}: {action.text}"
            _action(svg, frame, action, text, 900 + top + lanes[action.id] * LANE, flown.until)
    if len(flown.actions) > MAX_LANES:
        svg.text(MARGIN, svg.height - 4, "more actions than there is room for: see mission.log", 11, FAINT)


def _modes(svg: Svg, frame: Frame, track: Track, until: float) -> None:
    changes = [*track.modes, (until, "")]
    shades = {name: MODE_SHADES[index % 4] for index, name in enumerate(dict.fromkeys(name for _, name in track.modes))}
    for (begin, name), (end, _) in pairwise(changes):
        x, right = frame.at(begin, 0)[0], frame.at(end, 0)[0]
        svg.add("rect", x=x, y=frame.top, width=max(0.0, right - x), height=frame.height, fill=shades[name])
        svg.line(x, frame.top, x, frame.top + frame.height, "#afb8c1", stroke_dasharray="3 3")
        if right - x > 8 + 6.6 * len(name):  # else it would run into the next one's
            svg.text(x + 4, frame.top + 13, name, 10, FAINT)


def _action(svg: Svg, frame: Frame, action: ActionSeen, text: str, y: float, until: float) -> None:
    begin = frame.at(action.began, 0)[0]
    end = frame.at(action.ended if action.ended is not None else until, 0)[0]
    colour = OUTCOMES.get(action.state, "#9a6700")
    svg.add("rect", x=begin, y=y, width=max(2.0, end - begin), height=5, rx=2.5, fill=colour)
    text = text if len(text) <= 52 else f"{text[:51]}…"
    if action.state != "succeeded":
        text += f" {action.state}"
    if end + 6.2 * len(text) > WIDTH - MARGIN / 2:
        svg.text(begin - 6, y + 7, text, 10.5, INK, text_anchor="end")
    else:
        svg.text(end + 6, y + 7, text, 10.5, INK)


def _lanes(actions: list[ActionSeen]) -> dict[str, int]:
    """Return on which line each action stands: one after the other, as far as there is room."""
    return {action.id: lane for lane, action in enumerate(actions[:MAX_LANES])}


def _targets(actions: list[ActionSeen]) -> list[tuple[float, float, float]]:
    """Return latitude, longitude and altitude of every place that an action named, each once."""
    found: dict[tuple[float, float, float], None] = {}
    for action in actions:
        if action.name in ("goto", "setpoint") and len(action.parameters) == 3:
            latitude, longitude, altitude = map(to_float, action.parameters)
            if latitude is not None and longitude is not None and altitude is not None:
                found[latitude, longitude, altitude] = None
    return list(found)


def _flight(track: Track) -> list[Point]:
    """Return the points while armed, or all of them if the vehicle was never seen armed."""
    return [point for point in track.points if track.armed(point.at)] or track.points


def _home(svg: Svg, x: float, y: float) -> None:
    svg.add("circle", cx=x, cy=y, r=7, fill=PAPER, stroke=INK, stroke_width=1.5)
    svg.text(x, y + 3.6, "H", 10, INK, text_anchor="middle", font_weight="700")


def _diamond(svg: Svg, x: float, y: float) -> None:
    corners = f"M{x:.1f},{y - 7:.1f}l7,7l-7,7l-7,-7z"
    svg.add("path", d=corners, fill="#ffffff", stroke="#8250df", stroke_width=2)
