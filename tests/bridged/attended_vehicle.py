"""A simulated vehicle of any kind in virtual time, and a ground station that is heard each second."""

import math
from itertools import groupby

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.kinds import KINDS
from bridged.simulation.vehicle.motion.dynamics import Vector
from tests.bridged.virtual_copter import Station

NAN = math.nan
HERE = 0
"""x and y of an item without a place."""
Item = tuple[int, int, tuple[float, float, float, float], Vector | None, float]
"""Command, frame, parameters 1 to 4, place, height."""


class AttendedVehicle(Station):
    """Tells `silent` = True to keep the ground station silent."""

    def __init__(self, vehicle: str, autopilot: str, *faults: str) -> None:
        self.silent, self._beat_at = False, 0.0
        super().__init__(kind=KINDS[vehicle, autopilot], faults=faults)

    def wait(self, seconds: float) -> list[dialect.MAVLink_message]:
        """Lets time pass, with a HEARTBEAT at each second; returns what was heard meanwhile."""
        heard, end = [], self.now + seconds
        while end - self.now > 0.01:
            if not self.silent and self.now >= self._beat_at:
                self.heartbeat()
                self._beat_at = self.now + 1.0
            heard += super().wait(max(0.02, min(end, self._beat_at, self.now + 1.0) - self.now))
        return heard

    def place(self, command: int, goal: Vector | None, *params: float, alt: float = NAN, frame: int = 0) -> int:
        """Sends a COMMAND_INT to a place; returns the result of its acknowledgement."""
        lat = lon = 2**31 - 1
        if goal is not None:
            place = self.autopilot.chart.place(goal)
            lat, lon = place.lat_e7, place.lon_e7
            alt = place.alt if math.isnan(alt) else alt
        replies = self.say(dialect.MAVLink_command_int_message(1, 1, frame, command, 0, 0, *params, lat, lon, alt))
        (result,) = [reply.result for reply in replies if reply.get_type() == "COMMAND_ACK"]
        return int(result)

    def upload(self, items: list[Item], kind: int = 0) -> int:
        """Uploads a list of items as the vehicle asks for them; returns the type of MISSION_ACK."""
        replies = self.say(dialect.MAVLink_mission_count_message(1, 1, len(items), kind))
        for _ in range(4 * len(items) + 4):
            asked = [one for one in replies if one.get_type() in ("MISSION_REQUEST", "MISSION_REQUEST_INT")]
            acks = [int(one.type) for one in replies if one.get_type() == "MISSION_ACK"]
            if acks:
                return acks[-1]
            replies = self.say(self._item(asked[-1].seq, items[asked[-1].seq], kind)) if asked else self.wait(0.1)
        raise AssertionError("no MISSION_ACK")

    def _item(self, seq: int, item: Item, kind: int) -> dialect.MAVLink_message:
        command, frame, params, goal, height = item
        at = self.autopilot.chart.place(goal) if goal is not None else None
        x, y = (at.lat_e7, at.lon_e7) if at is not None else (HERE, HERE)
        return dialect.MAVLink_mission_item_int_message(1, 1, seq, frame, command, 0, 1, *params, x, y, height, kind)

    def velocity(self, north: float, east: float, down: float = 0.0) -> None:
        self.say(
            dialect.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, 1, 0b010111000111, 0, 0, 0, north, east, down, 0, 0, 0, 0, 0
            )
        )

    def last(self, kind: str) -> dialect.MAVLink_message:
        return next(message for message in reversed(self.heard) if message.get_type() == kind)

    @property
    def said(self) -> list[str]:
        """Texts, put together from their pieces, without the tab at their end."""
        texts = [one for one in self.heard if one.get_type() == "STATUSTEXT"]
        whole = [
            "".join(one.text for one in pieces) for _, pieces in groupby(texts, lambda one: one.id or one.get_seq())
        ]
        return [text.rstrip("\t") for text in whole]
