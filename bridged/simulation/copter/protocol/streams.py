"""Which messages a vehicle sends by itself, and when the next one is due."""

from dataclasses import dataclass, field

from bridged.simulation.copter.protocol.telemetry import BUILDERS

SHORTEST_INTERVAL_S = 0.02
"""Faster requests are slowed to this, in vehicle seconds."""

DEFAULTS_S = {0: 1.0}
"""Intervals after power on: HEARTBEAT only (recorded)."""

GROUPS: dict[int, tuple[int, ...]] = {
    1: (),  # RAW_SENSORS: no raw sensors are simulated
    2: (1, 24, 42, 62, 87, 125, 152, 162),  # EXTENDED_STATUS
    3: (36, 65),  # RC_CHANNELS
    6: (32, 33),  # POSITION
    10: (30,),  # EXTRA1
    11: (74,),  # EXTRA2
    12: (2, 147, 193, 241),  # EXTRA3
}
"""Stream groups of REQUEST_DATA_STREAM (MAV_DATA_STREAM), as ArduPilot fills them."""

ALL_GROUPS = 0


@dataclass(slots=True)
class Streams:
    """Intervals in vehicle seconds by message id."""

    intervals: dict[int, float] = field(default_factory=lambda: dict(DEFAULTS_S))
    _due: dict[int, float] = field(default_factory=dict)

    def knows(self, message: int) -> bool:
        """Whether the vehicle can send the message at all."""
        return message in BUILDERS

    def interval_us(self, message: int) -> int:
        """Microseconds as MESSAGE_INTERVAL tells them: 0 unknown, -1 not sent."""
        if not self.knows(message):
            return 0
        interval = self.intervals.get(message)
        return -1 if interval is None else round(interval * 1e6)

    def set(self, message: int, interval_us: float, now: float) -> bool:
        """Sets an interval: -1 stops, 0 is the default. False for a message that is unknown."""
        if not self.knows(message):
            return False
        seconds = DEFAULTS_S.get(message) if interval_us == 0 else interval_us / 1e6
        if seconds is None or seconds < 0:
            self.intervals.pop(message, None)
            self._due.pop(message, None)
        else:
            self.intervals[message] = max(SHORTEST_INTERVAL_S, seconds)
            self._due[message] = now + self.intervals[message]
        return True

    def request(self, group: int, rate: int, now: float, *, on: bool) -> None:
        """REQUEST_DATA_STREAM: the messages of a group at `rate` Hz, or not at all."""
        groups = GROUPS.values() if group == ALL_GROUPS else (GROUPS.get(group, ()),)
        interval_us = 1e6 / rate if on and rate > 0 else -1.0
        for messages in groups:
            for message in messages:
                self.set(message, interval_us, now)

    def due(self, now: float) -> list[int]:
        """The messages to send now."""
        ready = [message for message in self.intervals if self._due.get(message, 0.0) <= now + 1e-9]
        for message in ready:
            interval = self.intervals[message]
            last = self._due.get(message, now)
            # The rhythm is kept unless the vehicle was asked nothing for long.
            self._due[message] = last + interval if last + interval > now else now + interval
        return ready

    def next_due(self) -> float:
        """When the next message is due, in vehicle seconds."""
        return min(self._due.get(message, 0.0) for message in self.intervals) if self.intervals else float("inf")
