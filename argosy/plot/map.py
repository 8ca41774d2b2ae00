"""The plan view of a plot: the flown tracks in metres east and north of home, with all that is marked on them."""

from __future__ import annotations

from typing import Any

from matplotlib.lines import Line2D

from argosy.fleet_model.robots import Track
from argosy.plot.data import TARGET, Place, Scene
from argosy.plot.panels import colour_of, robot_handles
from argosy.plot.style import INK, LEFT_MARKERS, SEEN_MARKERS
from schemas.geo import offset

LOWEST, HIGHEST = 0.3, 0.95
"""Height of the plan by its width, at least and at most."""
LEAST = 20.0
"""Metres that are shown at least, so that a vehicle that stays in its place is no cloud of noise."""
SEEN = "#ffe680"
"""Colour of what was seen."""
MARGIN = 0.57
"""Half of what is shown by what there is."""
MOST_LABELS = 12
"""Places of one kind up to which their labels are written."""


def shape(scene: Scene) -> float:
    """Return the height of the plan by its width that its contents want."""
    points = _extent(scene)
    east, north = ([point[axis] for point in points] for axis in (0, 1))
    wide, high = max(max(east) - min(east), LEAST), max(max(north) - min(north), LEAST)
    return min(HIGHEST, max(LOWEST, (high + 0.04 * wide) / wide))


def plan(axes: Any, scene: Scene, ratio: float) -> list[Any]:
    """Draw the tracks and places; both axes have one scale, `ratio` is the height of the plan by its width."""
    origin = scene.origin or (0.0, 0.0)
    for name, track in scene.tracks.items():
        colour, line = colour_of(scene, name)
        path = _path(track, scene, origin)
        if path:
            axes.plot([x for x, _ in path], [y for _, y in path], color=colour, linestyle=line, linewidth=0.9, zorder=2)
            axes.plot(*path[-1], marker="o", color=colour, markersize=3.2, markeredgewidth=0, zorder=3)
    (west, east), (south, north) = ((min(values), max(values)) for values in zip(*_extent(scene), strict=True))
    half = max(east - west, LEAST, (north - south) / ratio) * MARGIN
    axes.set_xlim((west + east) / 2 - half, (west + east) / 2 + half)
    axes.set_ylim((south + north) / 2 - half * ratio, (south + north) / 2 + half * ratio)
    axes.set_xlabel("m east of home", labelpad=1.5)
    axes.set_ylabel("m north of home")
    return [*robot_handles(scene), *_homes(axes, scene, origin), *_places(axes, scene, origin)]


def _homes(axes: Any, scene: Scene, origin: tuple[float, float]) -> list[Any]:
    style: dict[str, Any] = {
        "marker": "o",
        "color": "white",
        "markeredgecolor": INK,
        "markersize": 6,
        "markeredgewidth": 0.7,
    }
    homes = [track.home for track in scene.tracks.values() if track.home is not None]
    for home in dict.fromkeys(homes):
        x, y = offset(origin, home)
        axes.plot(x, y, linestyle="none", zorder=5, **style)
        axes.annotate("H", (x, y), ha="center", va="center_baseline", fontsize="xx-small", fontweight="bold", zorder=6)
    return [Line2D([], [], linestyle="none", label="home", **style)] if homes else []


def _places(axes: Any, scene: Scene, origin: tuple[float, float]) -> list[Any]:
    kinds: dict[str, list[Place]] = {}
    for place in sorted(scene.places, key=lambda place: place.kind != TARGET):
        kinds.setdefault(place.kind, []).append(place)
    handles = []
    seen, left = iter(SEEN_MARKERS), iter(LEFT_MARKERS)
    for kind, places in kinds.items():
        target = kind == TARGET
        marker = "D" if target else next(seen if places[0].label else left, "1")
        style: dict[str, Any] = {"marker": marker, "markersize": 4 if target else 9 if marker == "*" else 3.6}
        for place in places:
            x, y = offset(origin, place.position)
            colour = colour_of(scene, place.robot)[0]
            fill = "none" if target else SEEN if place.label else colour  # others may have seen it, too
            edge = colour if target else INK
            look: dict[str, Any] = {
                "markerfacecolor": fill,
                "markeredgecolor": edge,
                "markeredgewidth": 0.7 if target else 0.5,
            }
            axes.plot(x, y, linestyle="none", zorder=4, **style, **look)
            if place.label and len(places) <= MOST_LABELS:
                axes.annotate(
                    place.label,
                    (x, y),
                    (3.5, 2.5),
                    textcoords="offset points",
                    fontsize="smaller",
                    zorder=7,
                    clip_on=True,
                )
        legend: dict[str, Any] = {
            "markerfacecolor": "none" if target else SEEN if places[0].label else "#d0d7de",
            "markeredgecolor": INK,
            "markeredgewidth": 0.6,
        }
        handles.append(Line2D([], [], linestyle="none", label=kind, **style, **legend))
    return handles


def _path(track: Track, scene: Scene, origin: tuple[float, float]) -> list[tuple[float, float]]:
    """Return the points while armed, or all if the vehicle was never seen armed."""
    inside = [point for point in track.points if scene.begin <= point.at <= scene.end]
    flown = [point for point in inside if track.armed(point.at)] or inside
    return [offset(origin, (point.latitude, point.longitude)) for point in flown]


def _extent(scene: Scene) -> list[tuple[float, float]]:
    origin = scene.origin or (0.0, 0.0)
    points = [point for track in scene.tracks.values() for point in _path(track, scene, origin)]
    homes = [offset(origin, track.home) for track in scene.tracks.values() if track.home is not None]
    own = [place for place in scene.places if place.robot in scene.robots]
    return [*points, *homes, *(offset(origin, place.position) for place in own)] or [(0.0, 0.0)]
