"""The geofence of the simulated PX4: uploaded polygons and circles, and the distances of GF_MAX_ parameters."""

from collections.abc import Sequence

from bridged.simulation.vehicle.geodesy import FlatMap
from bridged.simulation.vehicle.mission_items import Item
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.parameters import Parameters
from schemas.geo import is_inside

POLYGON_IN, POLYGON_OUT, CIRCLE_IN, CIRCLE_OUT = 5001, 5002, 5003, 5004
"""Commands of fence items (MAV_CMD_NAV_FENCE_...)."""


class Fence:
    """Where the vehicle may be."""

    def __init__(self, parameters: Parameters, items: Sequence[Item] = ()) -> None:
        self._parameters = parameters
        self.items = list(items)

    def allows(self, at: Vector, home: Vector, chart: FlatMap) -> bool:
        """Return whether a place on the map is within the fence."""
        farthest, highest = self._parameters["GF_MAX_HOR_DIST"], self._parameters["GF_MAX_VER_DIST"]
        if (farthest > 0 and at.distance(home) > farthest) or (highest > 0 and at.up - home.up > highest):
            return False
        inside = []
        items = list(self.items)
        while items:
            first = items[0]
            if first.command in (POLYGON_IN, POLYGON_OUT):
                count = max(1, int(first.params[0]))
                corners, items = [_vector(item, chart) for item in items[:count]], items[count:]
                within = is_inside((at.north, at.east), [(corner.north, corner.east) for corner in corners])
            else:
                items = items[1:]
                within = at.distance(_vector(first, chart)) <= first.params[0]
            if first.command in (POLYGON_OUT, CIRCLE_OUT) and within:
                return False
            if first.command in (POLYGON_IN, CIRCLE_IN):
                inside.append(within)
        return any(inside) or not inside


def _vector(item: Item, chart: FlatMap) -> Vector:
    return chart.at(item.x / 1e7, item.y / 1e7, chart.origin.alt)
