"""Places on the earth, and the flat map around one of them."""

import math

import msgspec

from bridged.simulation.vehicle.motion.dynamics import Vector

METRES_PER_DEGREE = 111_319.5
"""Length of one degree of latitude that the recorded autopilot uses (earth radius 6378.1 km)."""


class Place(msgspec.Struct, frozen=True):
    """Latitude and longitude in degrees, altitude in metres above mean sea level."""

    lat: float
    lon: float
    alt: float

    def __post_init__(self) -> None:
        if not (abs(self.lat) <= 90 and abs(self.lon) <= 180 and math.isfinite(self.alt)):
            raise ValueError(
                f"not a place on the earth: latitude {self.lat}, longitude {self.lon}, altitude {self.alt}"
            )

    @property
    def lat_e7(self) -> int:
        """1e-7 degrees"""
        return round(self.lat * 1e7)

    @property
    def lon_e7(self) -> int:
        """1e-7 degrees"""
        return round(self.lon * 1e7)

    @property
    def alt_mm(self) -> int:
        """Millimetres above mean sea level."""
        return round(self.alt * 1e3)


class FlatMap:
    """Metres north, east and up of an origin. Good to some millimetres over the few kilometres that a copter flies."""

    def __init__(self, origin: Place) -> None:
        self.origin = origin
        self._east_scale = METRES_PER_DEGREE * max(0.01, math.cos(math.radians(origin.lat)))

    def place(self, at: Vector) -> Place:
        """Return the place at a vector; latitudes are clamped to the poles."""
        lat = max(-90.0, min(90.0, self.origin.lat + at.north / METRES_PER_DEGREE))
        lon = math.remainder(self.origin.lon + at.east / self._east_scale, 360.0)
        return Place(lat, lon, self.origin.alt + at.up)

    def vector(self, place: Place) -> Vector:
        """Return the vector of a place."""
        return self.at(place.lat, place.lon, place.alt)

    def at(self, lat: float, lon: float, alt: float) -> Vector:
        """Return the vector of degrees, even beyond the poles, and metres above mean sea level."""
        east = math.remainder(lon - self.origin.lon, 360.0) * self._east_scale
        return Vector((lat - self.origin.lat) * METRES_PER_DEGREE, east, alt - self.origin.alt)
