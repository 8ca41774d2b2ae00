"""Plays the recorded exchanges of tests/data/INDEX.json and tests/data/autopilots/INDEX.json into simulated vehicles.

What is compared, per entry and in the window of the entry: acknowledgements, changes of mode, arming and landed state,
texts, parameters that were asked for, MESSAGE_INTERVAL, home, targets, mission messages, the place of the vehicle,
and that nothing else of these kinds was said. What is not compared: PARAM_VALUEs that nobody asked for (calibration
and statistics of the recorded vehicle), order between different kinds, digits inside texts.

In the recordings of several autopilots also: system_status, CURRENT_MODE, MISSION_CURRENT, the mode at the end of an
entry. Not: EVENTs, the index of a parameter among those of the real vehicle, names of log files. HEARTBEAT,
CURRENT_MODE and HOME_POSITION are sent when the recorded ones were: a short mode is seen by whoever looks then.
"""

import json
import math
import re
import struct
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport.framing import Encoder, Framer, WireCounters
from bridged.simulation.vehicle.autopilot import STEP_S
from bridged.simulation.vehicle.geodesy import METRES_PER_DEGREE, Place
from bridged.simulation.vehicle.kinds import KINDS
from bridged.simulation.vehicle.vehicle import Vehicle
from tests.bridged.recorded import DATA, packets, start_of

FIELD = Place(-27.604033, -48.518363, 21.1)
"""Home of the recordings as the recorded vehicle reported it."""

PX4_FIELD = Place(FIELD.lat, FIELD.lon, 20.99)
"""The same as PX4 reported it."""

HOMES = {1: FIELD, 2: Place(FIELD.lat, -48.5182615, FIELD.alt), 3: Place(FIELD.lat, -48.5181603, FIELD.alt)}
VEHICLE_SECONDS = {"three_uav.tlog.gz": 5.016}
"""Vehicle seconds per recorded second (dynamics.json), 1 for the other files."""

LATE_S = 0.6
"""How much earlier or later than recorded something may happen, in vehicle seconds ..."""

LATE_SHARE = 0.1
"""... plus this share of the time since the exchange began."""

ANSWERS = ("COMMAND_ACK", "MESSAGE_INTERVAL", "MISSION_ACK", "MISSION_COUNT", "MISSION_ITEM_INT")
"""What comes at once: it belongs to its own exchange and to no other."""

PERIODIC = ("POSITION_TARGET_GLOBAL_INT",)
"""Streams of which the index holds one sample."""

STATES = ("HEARTBEAT", "EXTENDED_SYS_STATE")
NEW_STATES = (*STATES, "CURRENT_MODE", "MISSION_CURRENT", "MISSION_ITEM_REACHED", "ORBIT_EXECUTION_STATUS")
"""Kinds of messages that come again and again: the index holds those that tell something new."""

UNASKED_PARAMETERS = (
    "INS_", "BARO", "STAT_", "EK3_", "MOT_THST_HOVER", "ARSPD_OFFSET", "SIM_PIN_MASK", "RELAY", "CAM1_", "CAM2_",
)  # fmt: skip

CIRCLE = 190.0
"""Metres across the circle of a plane."""

AUTOPILOTS = "autopilots"
"""Folder of the recordings of several vehicles and autopilots."""

ALIGNED = {"HEARTBEAT": 0, "MISSION_CURRENT": 42, "HOME_POSITION": 242, "CURRENT_MODE": 436}
"""Streams that are sent when the recorded ones were."""

TAKEN_S = 0.012
"""Seconds after which a message of ours is taken: answers came after 2 to 30 ms."""

OFF = {"px4_quad_failsafe.tlog.gz": ("process_ended", "process_started_again")}
"""Entries at which the recorded process ended, and was started again."""

Record = dict[str, Any]


@dataclass
class Said:
    """One message of a simulated vehicle, at recorder seconds after the first packet of the file."""

    at: float
    message: dialect.MAVLink_message
    note: str = ""


@dataclass
class Playback:
    """What the simulated vehicles of one file said, by system id."""

    entries: list[Record]
    begin: int
    scale: float
    said: dict[int, list[Said]]
    truth: dict[int, list[Said]] = field(default_factory=dict)
    new: bool = False
    """Whether it is one of the recordings of several autopilots."""
    beats: list[Said] = field(default_factory=list)
    """HEARTBEATs as they were recorded."""
    circles: bool = False
    """Whether it is a plane: where on its circle it is does not count."""

    def seconds(self, t_us: int) -> float:
        return (t_us - self.begin) / 1e6

    def recorded(self, system: int) -> list[tuple[float, tuple[object, ...] | None]]:
        """All that is recorded of one vehicle, whatever exchange it stands in."""
        return [
            (self.seconds(entry["t_us"]) + reply["dt_ms"] / 1e3, self.facts(reply))
            for entry in self.entries
            if (entry.get("sysid") or 1) == system
            for reply in entry["replies"]
        ]

    def before(self, entry: Record) -> float:
        """When the entry before ended."""
        at = next(number for number, one in enumerate(self.entries) if one is entry)
        return window(self, self.entries[at - 1])[1] if at else 0.0

    def repeated(self, reply: Record) -> bool:
        """Whether PX4 reports an item that it has reached once more, as it does each second."""
        if not self.new or reply["msg"] != "MISSION_ITEM_REACHED":
            return False
        reached = [one for entry in self.entries for one in entry["replies"] if one["msg"] == reply["msg"]]
        at = next(number for number, one in enumerate(reached) if one is reply)
        return at > 0 and reached[at - 1]["seq"] == reply["seq"]

    @property
    def periodic(self) -> tuple[str, ...]:
        """Streams of which the index does not hold every message."""
        return (*PERIODIC, "HOME_POSITION", "GPS_GLOBAL_ORIGIN") if self.new else PERIODIC

    def facts(self, record: Record) -> tuple[object, ...] | None:
        """What counts of a reply."""
        return facts(record, self.new)


@cache
def index() -> dict[str, list[Record]]:
    entries: dict[str, list[Record]] = json.loads((DATA / "INDEX.json").read_text())
    further: dict[str, list[Record]] = json.loads((DATA / AUTOPILOTS / "INDEX.json").read_text())
    return entries | further


def is_new(name: str) -> bool:
    """Whether a file is one of the recordings of several autopilots."""
    return name.startswith(("px4_", "ardu_"))


def message_of(record: Record) -> dialect.MAVLink_message:
    """The MAVLink message of one `sent` of the index."""
    kind = getattr(dialect, f"MAVLink_{record['msg'].lower()}_message")
    values = []
    for name in kind.fieldnames:
        value = record.get(name, {"target_system": 1, "target_component": 1}.get(name, 0))
        values.append(value.encode() if isinstance(value, str) else value)
    return kind(*values)


def play(name: str, entries: list[Record]) -> Playback:
    """Sends what was sent, when it was sent, and collects what comes back."""
    if is_new(name):
        return play_new(name, entries)
    begin, scale = entries[0]["t_us"], VEHICLE_SECONDS.get(name, 1.0)
    systems = sorted({entry["sysid"] for entry in entries if entry.get("sysid")})
    vehicles = {system: Vehicle(HOMES[system], system=system, boot="real") for system in systems}
    end = begin
    inbox: list[tuple[int, int, dialect.MAVLink_message]] = []  # time, vehicle or 0 for all, message
    sender = (255, 190)
    recorded_truth: dict[int, list[Said]] = {system: [] for system in systems}
    for packet in packets(name.removesuffix(".tlog.gz")):
        message, t_us = packet.message, begin + round(packet.at * 1e6)
        end = t_us
        source = (message.get_srcSystem(), message.get_srcComponent())
        if source[1] != 1:
            if message.get_type() == "HEARTBEAT":
                inbox.append((t_us, 0, _heard(message, source)))
                sender = source if source[0] != 245 else sender
        elif message.get_type() == "GLOBAL_POSITION_INT":
            recorded_truth[source[0]].append(Said((t_us - begin) / 1e6, message))
    for entry in entries:
        for sent in entry["sent"]:
            inbox.append((sent["t_us"], entry["sysid"], _heard(message_of(sent), sender)))
    inbox.sort(key=lambda item: item[0])
    playback = Playback(entries, begin, scale, {system: [] for system in systems}, recorded_truth)
    for system, vehicle in vehicles.items():
        playback.said[system] = _fly(vehicle, [(t, m) for t, to, m in inbox if to in (0, system)], begin, end, scale)
    return playback


def _fly(
    vehicle: Vehicle, inbox: list[tuple[int, dialect.MAVLink_message]], begin: int, end: int, scale: float
) -> list[Said]:
    said: list[Said] = []
    now = 0.0  # vehicle seconds after the first heartbeat

    def until(t: float) -> None:
        nonlocal now
        while now < t:
            step = min(STEP_S, t - now)
            now += step
            said.extend(Said(now / scale, message) for message in vehicle.advance(step))

    for t_us, message in inbox:
        until((t_us - begin) / 1e6 * scale)
        said.extend(Said((t_us - begin) / 1e6, reply) for reply in vehicle.receive(message))
    until((end - begin) / 1e6 * scale)
    _note_changes(said)
    return said


def play_new(name: str, entries: list[Record]) -> Playback:
    """The same for a recording of several autopilots: all that was sent stands in it."""
    begin = entries[0]["t_us"]
    autopilot, vehicle_name = name.removesuffix(".tlog.gz").split("_")[:2]
    vehicle_name = {"quad": "copter"}.get(vehicle_name, vehicle_name)
    kind = KINDS[vehicle_name, {"ardu": "ardupilot"}.get(autopilot, autopilot)]
    vehicle = Vehicle(PX4_FIELD if autopilot == "px4" else FIELD, kind, boot="real")
    playback = Playback(entries, begin, 1.0, {1: []}, {1: []}, new=True, circles=vehicle_name == "plane")
    off, on = _off_and_on(name, entries)
    said, now, allowed, is_off = playback.said[1], 0.0, set[str](), False

    def until(t: float) -> None:
        nonlocal now
        while now < t:
            step = min(STEP_S, t - now)
            now += step
            if not is_off:
                keep(vehicle.advance(step))

    def keep(messages: list[dialect.MAVLink_message]) -> None:
        for message in messages:
            kind = message.get_type()
            if kind not in ALIGNED or kind in allowed or autopilot == "ardu":
                said.append(Said(now, message))
            allowed.discard(kind)

    end = begin
    for t_us, message, own in _packets(name):
        end, at = t_us, (t_us - begin) / 1e6
        if off <= at and not is_off and at < on:
            until(off)
            is_off = True
        if is_off and at >= on:
            until(at)
            vehicle._power_on(vehicle.autopilot.restarted(PX4_FIELD))  # its simulator starts at home again
            is_off = False
        if own:
            until(at)
            if not is_off:
                keep(vehicle.receive(message))
            continue
        kind = message.get_type()
        if kind in ALIGNED:
            until(at)
            allowed.add(kind)
            vehicle.channels[0].streams.send_now(ALIGNED[kind], vehicle.autopilot.now)
            keep(vehicle.handler.streamed(vehicle.channels[0], vehicle.autopilot.now))
        if kind == "GLOBAL_POSITION_INT":
            playback.truth[1].append(Said(at, message))
        elif kind == "HEARTBEAT":
            playback.beats.append(Said(at, message))
    until((end - begin) / 1e6)
    _note_changes(said, new=True)
    return playback


def _off_and_on(name: str, entries: list[Record]) -> tuple[float, float]:
    if name not in OFF:
        return math.inf, math.inf
    times = {entry["name"]: entry for entry in entries}
    off, on = (times[one] for one in OFF[name])
    first = next(reply["dt_ms"] for reply in on["replies"] if reply["msg"] == "HEARTBEAT")
    begin = entries[0]["t_us"]
    return (off["t_us"] - begin) / 1e6, (on["t_us"] - begin) / 1e6 + first / 1e3 - 0.1


def _packets(name: str) -> list[tuple[int, dialect.MAVLink_message, bool]]:
    """Time, message and whether we sent it."""
    start = start_of(f"{AUTOPILOTS}/{name.removesuffix('.tlog.gz')}")
    found = []
    for packet in packets(f"{AUTOPILOTS}/{name.removesuffix('.tlog.gz')}"):
        message = packet.message
        own = (message.get_srcSystem(), message.get_srcComponent()) != (1, 1)
        found.append((start + round((packet.at + own * TAKEN_S) * 1e6), message, own))
    return sorted(found, key=lambda one: one[0])


def _note_changes(said: list[Said], *, new: bool = False) -> None:
    """Marks the messages that tell a state which is not the one before, as the index does."""
    last: dict[str, Any] = {"HEARTBEAT": ("HEARTBEAT", 0, False, *[False] * new)}
    for item in said:
        kind = item.message.get_type()
        if kind in (NEW_STATES if new else STATES) and last.get(kind) != (state := facts(record_of(item), new)):
            last[kind], item.note = state, "changed"


def _heard(message: dialect.MAVLink_message, source: tuple[int, int]) -> dialect.MAVLink_message:
    """The message as a vehicle reads it from the wire."""
    (read,) = Framer(WireCounters()).feed(Encoder(*source).pack(message), datagram=True)
    return read


FACTS: dict[str, tuple[str, ...]] = {
    "COMMAND_ACK": ("command", "result", "target_system", "target_component"),
    "HEARTBEAT": ("custom_mode", "armed"),
    "EXTENDED_SYS_STATE": ("landed_state",),
    "STATUSTEXT": ("severity", "text"),
    "PARAM_VALUE": ("param_id", "param_value", "param_type", "param_index"),
    "MESSAGE_INTERVAL": ("message_id", "interval_us"),
    "MISSION_REQUEST": ("seq",),
    "MISSION_ITEM_REACHED": ("seq",),
    "MISSION_COUNT": ("count",),
    "MISSION_ACK": ("type",),
    "MISSION_ITEM_INT": ("seq", "frame", "command", "x", "y", "z"),
    "AUTOPILOT_VERSION": ("flight_sw_version",),
    **dict.fromkeys(("HOME_POSITION", "GPS_GLOBAL_ORIGIN", "POSITION_TARGET_GLOBAL_INT"), ()),
}
"""The fields that count of a recorded reply; other kinds are not compared."""

NEW_FACTS = FACTS | {
    "HEARTBEAT": ("custom_mode", "armed", "system_status"),
    "CURRENT_MODE": ("custom_mode", "intended_custom_mode"),
    "MISSION_CURRENT": ("seq", "total", "mission_state"),
    "PARAM_VALUE": ("param_id", "param_value", "param_type"),
    "PARAM_ERROR": ("param_id", "error"),
    "MISSION_REQUEST_INT": ("seq", "mission_type"),
    "PROTOCOL_VERSION": ("version", "min_version", "max_version"),
    "AVAILABLE_MODES": ("number_modes", "mode_index", "standard_mode", "custom_mode", "properties", "mode_name"),
    "ORBIT_EXECUTION_STATUS": ("radius",),
}
"""The same for the recordings of several autopilots."""


def facts(record: Record, new: bool) -> tuple[object, ...] | None:
    """What counts of a recorded reply; None if it is not compared."""
    kind, fields = record["msg"], (NEW_FACTS if new else FACTS).get(record["msg"])
    if fields is None or record.get("param_id", "").startswith(UNASKED_PARAMETERS):
        return None
    if new and record.get("text", "").startswith("[logger]"):
        return None
    found = {name: record[name] for name in fields}
    if kind == "STATUSTEXT":  # what is measured differs in its last digits
        found["text"] = re.sub(r"-?\d+(\.\d+)?" if new else r"\d+\.\d+", "#", record["text"])
    if kind == "MISSION_ITEM_INT":
        found["z"] = round(record["z"], 1)
    if kind == "PARAM_VALUE" and new:
        found["param_value"] = record.get("int32_by_bytes", record["param_value"])
    return kind, *found.values()


def record_of(said: Said) -> Record:
    """A message of a simulated vehicle in the form of the index."""
    message = said.message
    record: Record = {"msg": message.get_type(), **message.to_dict()}
    if record["msg"] == "PARAM_VALUE":
        (record["param_value"],) = struct.unpack("<f", struct.pack("<f", record["param_value"]))
    record |= {name: value.decode().rstrip("\0") for name, value in record.items() if isinstance(value, bytes)}
    if record["msg"] == "HEARTBEAT":
        record["armed"] = bool(message.base_mode & 128)
    if record["msg"] == "PARAM_VALUE" and record["param_type"] == dialect.MAV_PARAM_TYPE_INT32:
        (number,) = struct.unpack("<i", struct.pack("<f", record["param_value"]))
        record["int32_by_bytes"] = number
    return record


def window(playback: Playback, entry: Record) -> tuple[float, float]:
    """Recorder seconds at which an exchange begins and ends."""
    begin: int = entry["t_us"]
    end: int = entry.get("t_end_us", begin)
    return playback.seconds(begin), playback.seconds(end)


def differences(playback: Playback, entry: Record) -> list[str]:
    """How the simulated vehicle's answer to one entry differs from the recorded one; empty if it does not."""
    system = entry.get("sysid") or 1
    said, scale = playback.said[system], playback.scale
    begin, end = window(playback, entry)
    found = []

    def slack(at: float) -> float:
        return (LATE_S + LATE_SHARE * (at - begin) * scale) / scale

    candidates = [(item, playback.facts(record_of(item))) for item in said if _tells(item, playback.new)]
    early = playback.before(entry)
    wanted = [
        (
            reply["dt_ms"] / 1e3 + (early if number < _restart(entry) else begin),
            playback.facts(reply),
            reply,
        )
        for number, reply in enumerate(entry["replies"])
        if not playback.repeated(reply)
    ]
    used: set[int] = set()
    around = CIRCLE if playback.circles else 4.0 if playback.new else 0.5
    for at, fact, reply in wanted:
        if fact is None:
            continue
        near = [
            (abs(item.at - at), number)
            for number, (item, other) in enumerate(candidates)
            if other == fact and number not in used and abs(item.at - at) <= slack(at) and _alike(item, reply, around)
        ]
        if near:
            used.add(min(near)[1])
        else:
            found.append(f"missing after {at - begin:.2f} s: {fact}")
    recorded = playback.recorded(system)
    for number, (item, fact) in enumerate(candidates):
        if number in used or fact is None or not begin <= item.at <= end:
            continue
        if fact[0] in ANSWERS:
            found.append(f"not recorded, after {item.at - begin:.2f} s: {fact}")
        elif fact[0] not in playback.periodic and (item.at + slack(item.at) <= end or item.at == begin):
            # Near the borders of the window it may stand in the exchange before or after.
            elsewhere = any(other == fact and abs(at - item.at) <= slack(item.at) for at, other in recorded)
            if not elsewhere:
                found.append(f"not recorded, after {item.at - begin:.2f} s: {fact}")
    found += _displacement(playback, entry, system)
    if entry["name"] == "ready":
        found += _readiness(playback, entry, system)
    if playback.new:
        found += _mode_at_end(playback, entry)
    if "rates_hz" in entry:
        found += _rates(playback, entry)
    if entry["name"] == "intervals_lost":
        found += [
            f"sent without being asked again: {item.message.get_type()}"
            for item in said
            if end - 10 <= item.at <= end and item.message.get_type() == "GLOBAL_POSITION_INT"
        ]
    return found


def _tells(item: Said, new: bool) -> bool:
    return item.note == "changed" or item.message.get_type() not in (NEW_STATES if new else STATES)


def _mode_at_end(playback: Playback, entry: Record) -> list[str]:
    """The mode at the end of an entry is the recorded one, or was shortly before or after."""
    _, end = window(playback, entry)
    recorded = [item for item in playback.beats if item.at <= end]
    shown = [item.message for item in playback.said[1] if item.message.get_type() == "HEARTBEAT"]
    times = [item.at for item in playback.said[1] if item.message.get_type() == "HEARTBEAT"]
    if not recorded or not shown:
        return []
    at, mode = recorded[-1].at, recorded[-1].message.custom_mode
    near = [message.custom_mode for message, time in zip(shown, times, strict=True) if abs(time - at) <= LATE_S + 0.6]
    return [] if mode in near else [f"is in mode {near[-1:]} at the end, recorded {mode}"]


def _rates(playback: Playback, entry: Record) -> list[str]:
    begin, end = window(playback, entry)
    counts: dict[str, int] = {}
    for item in playback.said[1]:
        if begin <= item.at < end:
            counts[item.message.get_type()] = counts.get(item.message.get_type(), 0) + 1
    return [
        f"{kind} at {counts.get(kind, 0) / (end - begin):.1f} Hz, recorded {rate}"
        for kind, rate in entry["rates_hz"].items()
        if abs(counts.get(kind, 0) / (end - begin) - rate) > 0.2 * rate + 0.1
    ]


def _restart(entry: Record) -> int:
    """How many of an entry's first replies came before it: their times count from the end of the entry before."""
    times = [reply["dt_ms"] for reply in entry["replies"]]
    return next((number for number in range(1, len(times)) if times[number] < times[number - 1] - 500), 0)


def _alike(item: Said, reply: Record, around: float) -> bool:
    """Places within half a metre, altitudes within 20 cm; home, which is where a vehicle stopped, within `around`."""
    message = item.message
    match reply["msg"]:
        case "HOME_POSITION" | "GPS_GLOBAL_ORIGIN":
            flat = _metres(message.latitude, message.longitude, reply["latitude"], reply["longitude"])
            return flat < around and abs(message.altitude - reply["altitude"]) < 200
        case "POSITION_TARGET_GLOBAL_INT":
            flat = _metres(message.lat_int, message.lon_int, reply["lat_int"], reply["lon_int"])
            return flat < 0.5 and abs(message.alt - reply["alt"]) < 0.2
    return True


def _metres(lat: float, lon: float, other_lat: float, other_lon: float) -> float:
    north = (lat - other_lat) / 1e7 * METRES_PER_DEGREE
    east = (lon - other_lon) / 1e7 * METRES_PER_DEGREE * math.cos(math.radians(lat / 1e7))
    return math.hypot(north, east)


def _displacement(playback: Playback, entry: Record, system: int) -> list[str]:
    """At the end of the exchange the copter must be where the recorded one was."""
    begin, end = window(playback, entry)
    recorded = [item for item in playback.truth[system] if begin - 1 <= item.at <= end]
    simulated = [
        item
        for item in playback.said[system]
        if item.message.get_type() == "GLOBAL_POSITION_INT" and begin - 1 <= item.at <= end
    ]
    if not recorded and not simulated:
        return []
    if not recorded or not simulated:
        return ["positions are sent by only one of the two"] if end - begin > 1.2 / playback.scale else []
    last = recorded[-1]
    other = min(simulated, key=lambda item: abs(item.at - last.at))
    here, there = other.message, last.message
    flown = _metres(there.lat, there.lon, recorded[0].message.lat, recorded[0].message.lon)
    climbed = abs(there.relative_alt - recorded[0].message.relative_alt) / 1e3
    off = _metres(here.lat, here.lon, there.lat, there.lon)
    above = abs(here.relative_alt - there.relative_alt) / 1e3
    flat, high = (CIRCLE, 4.0) if playback.circles else (1.0, 0.5)
    apart = [(off, above)]
    if playback.new:  # a difference of an earlier exchange is not one of this
        apart.append(_way_apart(recorded, simulated, last, other))
    if all(off > flat + LATE_SHARE * flown or above > high + LATE_SHARE * climbed for off, above in apart):
        return [f"is {off:.1f} m away and {above:.1f} m above or below the recorded place at the end"]
    return []


def _way_apart(recorded: list[Said], simulated: list[Said], last: Said, other: Said) -> tuple[float, float]:
    """How far apart the ways of the two from the beginning of an exchange to its end are: metres, metres of height."""
    first = recorded[0].message
    start = min(simulated, key=lambda item: abs(item.at - recorded[0].at)).message
    here, there = other.message, last.message
    lat, lon = here.lat - start.lat + first.lat, here.lon - start.lon + first.lon
    climb, climbed = here.relative_alt - start.relative_alt, there.relative_alt - first.relative_alt
    return _metres(lat, lon, there.lat, there.lon), abs(climb - climbed) / 1e3


def _readiness(playback: Playback, entry: Record, system: int) -> list[str]:
    """Pre-arm bit, position flag of the estimator and GPS fix are all there when they were recorded to be."""
    if "t_seen_us" not in entry:
        return []
    seen = playback.seconds(entry["t_seen_us"])
    good: dict[str, float] = {}
    for item in playback.said[system]:
        message = item.message
        if item.at < playback.seconds(entry["t_us"]) - 2 / playback.scale:
            continue
        match message.get_type():
            case "SYS_STATUS" if message.onboard_control_sensors_health & 1 << 28:
                good.setdefault("prearm", item.at)
            case "EKF_STATUS_REPORT" | "ESTIMATOR_STATUS" if message.flags & 16:
                good.setdefault("ekf", item.at)
            case "GPS_RAW_INT" if message.fix_type >= 3:
                good.setdefault("gps", item.at)
    if len(good) < 3:
        return [f"never ready: only {sorted(good)}"]
    ready = max(good.values())
    limit = 2.0 / playback.scale
    return [] if abs(max(ready, playback.seconds(entry["t_us"])) - seen) <= limit else [f"ready at {ready:.1f} s"]
