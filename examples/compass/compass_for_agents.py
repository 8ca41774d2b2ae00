"""Directions for agents: an example of a package that extends AgentSpeak programs (docs/guides/extending.md)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from agentd import Failed, MindState, atom, deref, function, internal_action, suspend, undo, unify

POINTS = {"north": 0.0, "east": 90.0, "south": 180.0, "west": 270.0}


@function("compass.bearing", 4)
def bearing(mind: MindState, lat: Any, lon: Any, to_lat: Any, to_lon: Any) -> float | None:
    """``compass.bearing(Lat, Lon, ToLat, ToLon)``: degrees from north, 0 to 360, over a short distance."""
    if not all(isinstance(value, float) for value in (lat, lon, to_lat, to_lon)):
        return None  # it cannot be computed, and stays a term
    east = (to_lon - lon) * math.cos(math.radians(lat))
    return math.degrees(math.atan2(east, to_lat - lat)) % 360.0


@internal_action("compass.near", 3)
def near(mind: MindState, trail: Any, degrees: Any, point: Any, off: Any) -> bool:
    """``compass.near(Degrees, Point, Off)``: the nearest point of the compass, and how far it is off."""
    value = deref(degrees)
    if not isinstance(value, float):
        raise Failed("wrong_arguments", "compass.near takes degrees first")
    distance, name = min((abs((value - at + 180.0) % 360.0 - 180.0), name) for name, at in POINTS.items())
    return unify(point, atom(name), trail) and unify(off, distance, trail)


@internal_action("compass.point", 2, backtracks=True)
def each_point(mind: MindState, trail: Any, point: Any, degrees: Any) -> Iterator[None]:
    """``compass.point(Point, Degrees)``: every point of the compass, one after another."""
    mark = len(trail)
    for name, at in POINTS.items():
        if unify(point, atom(name), trail) and unify(degrees, at, trail):
            yield
        undo(trail, mark)


@internal_action("compass.settle", 1, suspends=True)
def settle(mind: MindState, trail: Any, seconds: Any) -> bool:
    """``compass.settle(Seconds)``: wait until the needle is at rest; the agent goes on with other intentions."""
    waiting = suspend(mind, "compass")
    mind.timers.at(mind.now + deref(seconds), waiting.resume)
    return True
