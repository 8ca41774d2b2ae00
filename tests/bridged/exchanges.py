"""Plays the recorded exchanges of tests/data/INDEX.json into simulated copters, in virtual time.

What is compared, per entry and in the window of the entry: acknowledgements, changes of mode, arming and landed state,
texts, parameters that were asked for, MESSAGE_INTERVAL, home, targets, mission messages, the place of the vehicle,
and that nothing else of these kinds was said. What is not compared: PARAM_VALUEs that nobody asked for (calibration
and statistics of the recorded vehicle), order between different kinds, digits inside texts.
"""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport.framing import Encoder, Framer, WireCounters
from bridged.simulation.vehicle.autopilot import STEP_S
from bridged.simulation.vehicle.geodesy import METRES_PER_DEGREE, Place
from bridged.simulation.vehicle.vehicle import Vehicle
from tests.bridged.recorded import DATA, packets

FIELD = Place(-27.604033, -48.518363, 21.1)
"""Home of the recordings as the recorded vehicle reported it."""

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

UNASKED_PARAMETERS = ("INS_", "BARO", "STAT_", "EK3_", "MOT_THST_HOVER")

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

    def seconds(self, t_us: int) -> float:
        return (t_us - self.begin) / 1e6

    def recorded(self, system: int) -> list[tuple[float, tuple[object, ...] | None]]:
        """All that is recorded of one vehicle, whatever exchange it stands in."""
        return [
            (self.seconds(entry["t_us"]) + reply["dt_ms"] / 1e3, facts(reply, entry["sent"]))
            for entry in self.entries
            if (entry.get("sysid") or 1) == system
            for reply in entry["replies"]
        ]


def index() -> dict[str, list[Record]]:
    entries: dict[str, list[Record]] = json.loads((DATA / "INDEX.json").read_text())
    return entries


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


def _note_changes(said: list[Said]) -> None:
    """Marks the HEARTBEATs and EXTENDED_SYS_STATEs that tell something new, as the index does."""
    last: dict[str, Any] = {"HEARTBEAT": (0, False)}
    for item in said:
        message, kind = item.message, item.message.get_type()
        state: Any = None
        if kind == "HEARTBEAT":
            state = (message.custom_mode, bool(message.base_mode & 128))
        elif kind == "EXTENDED_SYS_STATE":
            state = message.landed_state
        if state is not None and last.get(kind) != state:
            last[kind], item.note = state, "changed"


def _heard(message: dialect.MAVLink_message, source: tuple[int, int]) -> dialect.MAVLink_message:
    """The message as a vehicle reads it from the wire."""
    (read,) = Framer(WireCounters()).feed_datagram(Encoder(*source).pack(message))
    return read


def facts(record: Record, sent: list[Record]) -> tuple[object, ...] | None:
    """What counts of a recorded reply; None if it is not compared."""
    kind = record["msg"]
    match kind:
        case "COMMAND_ACK":
            return kind, record["command"], record["result"], record["target_system"], record["target_component"]
        case "HEARTBEAT":
            return kind, record["custom_mode"], record["armed"]
        case "EXTENDED_SYS_STATE":
            return kind, record["landed_state"]
        case "STATUSTEXT":
            return kind, record["severity"], _without_digits(record["text"])
        case "PARAM_VALUE":
            name = record["param_id"]
            if name.startswith(UNASKED_PARAMETERS):
                return None
            return kind, name, record["param_value"], record["param_type"], record["param_index"]
        case "MESSAGE_INTERVAL":
            return kind, record["message_id"], record["interval_us"]
        case "MISSION_REQUEST" | "MISSION_ITEM_REACHED":
            return kind, record["seq"]
        case "MISSION_COUNT":
            return kind, record["count"]
        case "MISSION_ACK":
            return kind, record["type"]
        case "MISSION_ITEM_INT":
            place = (record["seq"], record["frame"], record["command"], record["x"], record["y"])
            return kind, *place, round(record["z"], 1)
        case "AUTOPILOT_VERSION":
            return kind, record["flight_sw_version"]
        case "HOME_POSITION" | "GPS_GLOBAL_ORIGIN" | "POSITION_TARGET_GLOBAL_INT":
            return (kind,)
    return None


def _without_digits(text: str) -> str:
    """Speeds and altitudes measured differ in their last digits."""
    return re.sub(r"\d+\.\d+", "#", text)


def record_of(said: Said) -> Record:
    """A message of a simulated vehicle in the form of the index."""
    message = said.message
    record: Record = {"msg": message.get_type(), **message.to_dict()}
    if record["msg"] == "HEARTBEAT":
        record["armed"] = bool(message.base_mode & 128)
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

    candidates = [(item, facts(record_of(item), entry["sent"])) for item in said if _tells(item)]
    wanted = [(reply["dt_ms"] / 1e3 + begin, facts(reply, entry["sent"]), reply) for reply in entry["replies"]]
    used: set[int] = set()
    for at, fact, reply in wanted:
        if fact is None:
            continue
        near = [
            (abs(item.at - at), number)
            for number, (item, other) in enumerate(candidates)
            if other == fact and number not in used and abs(item.at - at) <= slack(at) and _alike(item, reply)
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
        elif fact[0] not in PERIODIC and (item.at + slack(item.at) <= end or item.at == begin):
            # Near the borders of the window it may stand in the exchange before or after.
            elsewhere = any(other == fact and abs(at - item.at) <= slack(item.at) for at, other in recorded)
            if not elsewhere:
                found.append(f"not recorded, after {item.at - begin:.2f} s: {fact}")
    found += _displacement(playback, entry, system)
    if entry["name"] == "ready":
        found += _readiness(playback, entry, system)
    if entry["name"] == "intervals_lost":
        found += [
            f"sent without being asked again: {item.message.get_type()}"
            for item in said
            if end - 10 <= item.at <= end and item.message.get_type() == "GLOBAL_POSITION_INT"
        ]
    return found


def _tells(item: Said) -> bool:
    return item.note == "changed" or item.message.get_type() not in ("HEARTBEAT", "EXTENDED_SYS_STATE")


def _alike(item: Said, reply: Record) -> bool:
    """Places within half a metre, altitudes within 20 cm."""
    message = item.message
    match reply["msg"]:
        case "HOME_POSITION" | "GPS_GLOBAL_ORIGIN":
            flat = _metres(message.latitude, message.longitude, reply["latitude"], reply["longitude"])
            return flat < 0.5 and abs(message.altitude - reply["altitude"]) < 200
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
    if off > 1.0 + LATE_SHARE * flown or above > 0.5 + LATE_SHARE * climbed:
        return [f"is {off:.1f} m away and {above:.1f} m above or below the recorded place at the end"]
    return []


def _readiness(playback: Playback, entry: Record, system: int) -> list[str]:
    """Pre-arm bit, EKF position flag and GPS fix are all there when they were recorded to be."""
    seen = playback.seconds(entry["t_seen_us"])
    good: dict[str, float] = {}
    for item in playback.said[system]:
        message = item.message
        if item.at < playback.seconds(entry["t_us"]) - 2 / playback.scale:
            continue
        match message.get_type():
            case "SYS_STATUS" if message.onboard_control_sensors_health & 1 << 28:
                good.setdefault("prearm", item.at)
            case "EKF_STATUS_REPORT" if message.flags & 16:
                good.setdefault("ekf", item.at)
            case "GPS_RAW_INT" if message.fix_type >= 3:
                good.setdefault("gps", item.at)
    if len(good) < 3:
        return [f"never ready: only {sorted(good)}"]
    ready = max(good.values())
    limit = 2.0 / playback.scale
    return [] if abs(max(ready, playback.seconds(entry["t_us"])) - seen) <= limit else [f"ready at {ready:.1f} s"]
