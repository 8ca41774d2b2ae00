"""The messages that a vehicle is asked to send, and their fields (facts/arducopter.md, Streams).

An autopilot sends little unasked, forgets what it was asked when it reboots, and other ground stations on the link
change its rates. Pure: messages by name go in, the next requests come out.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.autopilots.autopilot import Autopilot
from bridged.drivers.mavlink.vehicle.commands import Commands, MavlinkCommand
from bridged.drivers.mavlink.vehicle.readings import derived
from schemas.manifest.loader import Manifest, Retry
from schemas.wire.records import Note

UNASKED = frozenset({
    "HEARTBEAT", "STATUSTEXT", "HOME_POSITION", "COMMAND_ACK", "OVERRIDE", "LINK", "PARAM", "VEHICLE_TEXT", "MISSION",
    "MISSION_LIST",
    "PARAM_VALUE", "MISSION_ITEM_REACHED", "MISSION_ACK", "MISSION_COUNT",
    "COLLISION", "CAMERA_FEEDBACK", "CAMERA_IMAGE_CAPTURED", "CAMERA_TRIGGER",
})  # fmt: skip
"""Come by themselves, on request, or are the driver's own."""
SPORADIC = frozenset({
    "POSITION_TARGET_GLOBAL_INT", "POSITION_TARGET_LOCAL_NED", "FENCE_STATUS", "MISSION_CURRENT", "CURRENT_MODE",
})  # fmt: skip
"""Sent only in some states of the vehicle: their silence proves nothing."""
DEFAULT_RATE = 2.0
"""Hz for a percept whose manifest names no rate."""
IDLE_RATE = 0.5
"""Hz of wall time at most while the vehicle rests disarmed and nothing is asked of it: whatever the speed, a parked
robot costs next to nothing."""
IDLE_AFTER = (3.0, 1.0)
"""Mission and wall seconds for which the rates stay full after the last action, disarmed."""
WINDOW = 4.0
"""Mission and wall seconds over which the rate is judged."""
HOME_EVERY = 5.0
"""Mission and wall seconds between requests for a home that is not known yet."""
ASK = Retry(times=3)


@dataclass
class _Stream:
    number: int
    name: str
    rate: float
    """Hz while the vehicle is at work; 0 = nobody needs it, and it is stopped."""
    optional: bool = False
    """Not every vehicle has it: its absence is no warning."""
    asked: float = 0.0
    """Hz asked for last."""
    denied: bool = False
    pending: MavlinkCommand | None = None

    def starved(self, received: int, window: float) -> bool:
        """Whether fewer than half of the messages were `received` in the `window` seconds that end now."""
        sporadic = self.optional or self.name in SPORADIC
        return not self.denied and not sporadic and received < self.asked * window / 2


class Streams:
    """The messages that one vehicle is asked for.

    `speed` is mission seconds per wall second; `now` is in mission seconds.
    """

    def __init__(self, manifest: Manifest, autopilot: Autopilot, commands: Commands, speed: float) -> None:
        self.received: Counter[str] = Counter()
        """Messages by name in the present window; counted by the session."""
        self.requested = 0
        """Intervals asked for so far."""
        self.others_listen = False
        """Whether ground stations hear the vehicle by this link too (`forward`): nothing is stopped then."""
        self._commands = commands
        self._window = WINDOW * max(1.0, speed)
        self._scale = max(1.0, speed)
        self._idle_after, self._idle_at = max(IDLE_AFTER[0], IDLE_AFTER[1] * speed), 0.0
        self._autopilot = autopilot
        self._streams = {stream.name: stream for stream in _wanted(manifest, autopilot)}
        self._judge_at = math.inf
        self._home_at = math.inf
        self.at_work = False
        """Whether the full rates are asked for."""
        self._starved: list[str] = []

    def adopt(self, manifest: Manifest, autopilot: Autopilot, now: float) -> None:
        """Request the streams that another manifest or autopilot needs and that differ; now is in mission seconds."""
        old, self._autopilot = self._streams, autopilot
        self._streams = {}
        for stream in _wanted(manifest, autopilot):
            if not stream.rate and self.others_listen:
                continue
            known = old.get(stream.name, stream)
            known.rate, known.optional = stream.rate, stream.optional
            self._streams[stream.name] = known
            if self._judge_at < math.inf and known.asked != self._rate(known):
                self._ask(known, now)
        if self._judge_at < math.inf:
            self._open_window(now)

    def request(self, now: float) -> None:
        """Request all streams, as after a connect or a reboot."""
        for stream in self._streams.values():
            self._ask(stream, now)
        self._open_window(now)
        self._home_at = now

    def pace(self, *, busy: bool, now: float) -> None:
        """Request the full rates while the vehicle is `busy` and a little longer, else the idle ones.

        `busy`: it is armed, or something is asked of it; now is in mission seconds.
        """
        if busy:
            self._idle_at = now + self._idle_after
        if self.at_work == (now < self._idle_at):
            return
        self.at_work = not self.at_work
        if self._judge_at < math.inf:
            for stream in self._streams.values():
                if stream.asked != self._rate(stream) and not stream.denied:
                    self._ask(stream, now)
            self._open_window(now)

    def stop(self) -> None:
        """Stop judging rates while the link is lost."""
        self._judge_at = self._home_at = math.inf
        self._starved = []

    def tick(self, now: float, home_known: Callable[[], bool]) -> None:
        """Note denials, request streams below half of their rate again, and home until it is known.

        `now`: mission seconds.
        """
        for stream in self._streams.values():
            if stream.pending is not None and stream.pending.over:
                stream.denied = stream.pending.result in self._autopilot.stream_denials
                unheard = stream.pending.silent and stream.name in SPORADIC  # of the others, what came is judged
                stream.pending = None
                if (unheard or stream.asked != self._rate(stream)) and self._judge_at < math.inf:
                    self._ask(stream, now)
        if now >= self._judge_at:
            streams = self._streams.values()
            starved = [stream for stream in streams if stream.starved(self.received[stream.name], self._window)]
            self._starved = [stream.name for stream in starved]
            for stream in starved:
                self._ask(stream, now)
            self._open_window(now)
        if now >= self._home_at:
            self._home_at = math.inf if home_known() else now + HOME_EVERY * self._scale
            if not home_known():
                self._submit(dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_HOME_POSITION, 0.0, now)

    def notes(self) -> list[Note]:
        """Return what the vehicle was asked for and does not send."""
        denied = [
            stream.name for stream in self._streams.values() if stream.denied and stream.rate and not stream.optional
        ]
        notes = [Note("message_unknown", f"the vehicle does not know {name}", name) for name in denied]
        return notes + [
            Note("message_late", f"{name} arrives too rarely; requested again", name) for name in self._starved
        ]

    def _rate(self, stream: _Stream) -> float:
        return stream.rate if self.at_work else min(stream.rate, IDLE_RATE / self._scale)

    def _ask(self, stream: _Stream, now: float) -> None:
        if stream.pending is not None:
            return  # its acknowledgement must not be taken for that of another; `tick` asks again if need be
        stream.asked = rate = self._rate(stream)
        self.requested += 1
        interval = round(1e6 / rate) if rate else -1.0  # us; -1 stops it
        stream.pending = self._submit(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, stream.number, interval, now)

    def _submit(self, command: int, number: int, interval: float, now: float) -> MavlinkCommand:
        parameters = (float(number), float(interval), 0.0, 0.0, 0.0, 0.0, 0.0)
        return self._commands.submit(MavlinkCommand(command, parameters, ASK), now)

    def _open_window(self, now: float) -> None:
        self.received.clear()
        self._judge_at = now + self._window


def _wanted(manifest: Manifest, autopilot: Autopilot) -> Iterable[_Stream]:
    rates = dict.fromkeys(autopilot.unasked, 0.0) | dict(autopilot.needs)
    needed = set(autopilot.needs)
    for percept in manifest.percepts.values():
        name = autopilot.sources.get(percept.source, percept.source)
        if name not in UNASKED | autopilot.unrequestable:
            rates[name] = max(rates.get(name, 0.0), percept.rate or DEFAULT_RATE)
            if not percept.optional:
                needed.add(name)
    for name, rate in rates.items():
        yield _Stream(message_number(name), name, rate, optional=name not in needed)


def message_number(name: str) -> int:
    """The id of a message of the dialect. Raises ValueError for a name that it does not have."""
    try:
        return int(getattr(dialect, f"MAVLINK_MSG_ID_{name}"))
    except AttributeError:
        raise ValueError(f"MAVLink has no message {name}") from None


FOR_PERCEPTS_ONLY = (
    "ADSB_VEHICLE", "AHRS", "AHRS2", "AHRS3", "ALTITUDE", "ATTITUDE", "ATTITUDE_QUATERNION", "ATTITUDE_TARGET",
    "COLLISION", "DISTANCE_SENSOR",
    "ESC_TELEMETRY_1_TO_4", "ESC_TELEMETRY_5_TO_8", "GPS2_RAW", "GPS_RTK", "HIGHRES_IMU", "HWSTATUS", "MCU_STATUS",
    "MEMINFO", "OPTICAL_FLOW", "PID_TUNING", "POWER_STATUS", "RAW_IMU", "RC_CHANNELS_RAW", "RC_CHANNELS_SCALED",
    "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3", "SCALED_PRESSURE", "SCALED_PRESSURE2", "SCALED_PRESSURE3",
    "SENSOR_OFFSETS", "SIMSTATE", "SIM_STATE", "TERRAIN_REPORT", "TIMESYNC", "VFR_HUD", "VIBRATION",
    "WIND", "WIND_COV",
)  # fmt: skip
"""Telemetry that the driver itself does not need: read only for percepts."""


def unread(manifest: Manifest) -> frozenset[int]:
    """Return the ids of messages that nobody reads: they are not decoded."""
    sources = {percept.source for percept in manifest.percepts.values()}
    sources |= derived(sources).keys()
    return frozenset(getattr(dialect, f"MAVLINK_MSG_ID_{name}") for name in FOR_PERCEPTS_ONLY if name not in sources)
