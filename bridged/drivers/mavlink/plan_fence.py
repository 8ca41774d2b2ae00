"""Fence and rally points of QGroundControl's `.plan`: read into items of the vehicle's second and third list."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.actions.mission_items import RELATIVE, Item

_GLOBAL = dialect.MAV_FRAME_GLOBAL_INT
MAX_ALTITUDE = 1e5
"""Metres, up or down."""
MAX_RADIUS = 1e5
"""Metres."""


def fence_items(fence: Mapping[str, Any]) -> Iterator[Item]:
    """Yield the items of a `geoFence`: its polygons, then its circles. Raises ValueError."""
    for number, shape in enumerate(_shapes(fence, "polygons"), 1):
        where, corners = f"polygon {number} of the fence", shape.get("polygon")
        if not isinstance(corners, list) or len(corners) < 3:
            raise ValueError(f"{where}: expected `polygon`, a list of 3 corners or more")
        command = (
            dialect.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
            if _includes(where, shape)
            else dialect.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
        )
        for corner in corners:
            latitude, longitude = _numbers(f"{where}: a corner", corner, 90.0, 180.0)
            yield _item(command, float(len(corners)), latitude, longitude)
    for number, shape in enumerate(_shapes(fence, "circles"), 1):
        where = f"circle {number} of the fence"
        match shape.get("circle"):
            case {"center": center, "radius": radius}:
                (metres,) = _numbers(f"{where}: its radius", [radius], MAX_RADIUS)
                latitude, longitude = _numbers(f"{where}: its center", center, 90.0, 180.0)
            case _:
                raise ValueError(f"{where}: expected `circle` with `center` and `radius`")
        command = (
            dialect.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION
            if _includes(where, shape)
            else dialect.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION
        )
        yield _item(command, metres, latitude, longitude)


def rally_items(rally: Mapping[str, Any]) -> Iterator[Item]:
    """Yield the items of `rallyPoints`: places with metres above home. Raises ValueError."""
    points = rally.get("points", [])
    if not isinstance(points, list):
        raise ValueError("rally points: expected `points`, a list")
    for number, point in enumerate(points, 1):
        latitude, longitude, altitude = _numbers(f"rally point {number}", point, 90.0, 180.0, MAX_ALTITUDE)
        yield _item(dialect.MAV_CMD_NAV_RALLY_POINT, 0.0, latitude, longitude, altitude, RELATIVE)


def _item(
    command: int, first: float, latitude: float, longitude: float, altitude: float = 0.0, frame: int = _GLOBAL
) -> Item:
    return Item(command, frame, (first, 0.0, 0.0, 0.0), round(latitude * 1e7), round(longitude * 1e7), altitude)


def _shapes(fence: Mapping[str, Any], name: str) -> list[Mapping[str, Any]]:
    shapes = fence.get(name, [])
    if not isinstance(shapes, list) or not all(isinstance(shape, dict) for shape in shapes):
        raise ValueError(f"the fence: expected `{name}`, a list of objects")
    return shapes


def _includes(where: str, shape: Mapping[str, Any]) -> bool:
    """Whether the vehicle must stay in a shape, rather than out of it."""
    if isinstance(inclusion := shape.get("inclusion"), bool):
        return inclusion
    raise ValueError(f"{where}: expected `inclusion`, true or false")


def _numbers(where: str, value: object, *most: float) -> list[float]:
    """Return numbers, each no farther from 0 than the one of `most`."""
    if isinstance(value, list) and len(value) == len(most):
        fit = (isinstance(one, int | float) and not isinstance(one, bool) for one in value)
        if all(fit) and all(abs(one) <= limit for one, limit in zip(value, most, strict=True)):
            return [float(one) for one in value]
    ranges = " and ".join(f"{-limit:g} to {limit:g}" for limit in most)
    raise ValueError(f"{where}: expected {len(most)} numbers, {ranges}, got {value!r:.60}")
