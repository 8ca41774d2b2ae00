"""The state of a vehicle by its messages. Pure: decoded messages go in, with the time in mission seconds."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.vehicle.flight_modes import ModeTable, contradiction, table_of
from bridged.drivers.mavlink.vehicle.px4_events import acts, holds
from schemas import geo

_ARMED = dialect.MAV_MODE_FLAG_SAFETY_ARMED
_PREARM_CHECK = dialect.MAV_SYS_STATUS_PREARM_CHECK
_POS_HORIZ_ABS = dialect.EKF_POS_HORIZ_ABS
ON_GROUND = dialect.MAV_LANDED_STATE_ON_GROUND
ALOFT = frozenset({
    dialect.MAV_LANDED_STATE_IN_AIR, dialect.MAV_LANDED_STATE_TAKEOFF, dialect.MAV_LANDED_STATE_LANDING,
})  # fmt: skip
OFF_GROUND = 0.5
"""Metres above home that are no estimation error."""
UNKNOWN_HEADING = 65535
CRITICAL_WITHIN = 1.5
"""Mission seconds after the report of a failsafe within which a HEARTBEAT, one a second, has the state CRITICAL."""
GOES_DOWN = frozenset({dialect.MAV_STATE_EMERGENCY, dialect.MAV_STATE_FLIGHT_TERMINATION})
"""The states of an ArduPlane that has crashed, and of a vehicle whose flight is terminated: by itself, or by a pilot's
switch (PX4: kill)."""
CAMERAS = range(dialect.MAV_COMP_ID_CAMERA, dialect.MAV_COMP_ID_CAMERA6 + 1)
GIMBALS = (dialect.MAV_COMP_ID_GIMBAL, *range(dialect.MAV_COMP_ID_GIMBAL2, dialect.MAV_COMP_ID_GIMBAL6 + 1))
"""MAVLink component ids of a vehicle's system."""
ATTACHED = range(1, 7)
"""Ids of cameras and gimbals that are attached to the autopilot, which speaks for them."""
REBOOT_MS = 3000
"""`time_boot_ms` that goes back by more than this is a reboot, unless it begins again after 2^32 ms; less is datagrams
out of order."""


@dataclass(frozen=True, slots=True)
class Place:
    """A point over the earth: degrees, and metres in the frame that its owner defines."""

    latitude: float
    longitude: float
    altitude: float

    def distance(self, other: Place) -> float:
        """Return the horizontal distance in metres."""
        return geo.distance((self.latitude, self.longitude), (other.latitude, other.longitude))

    def moved(self, north: float, east: float, up: float) -> Place:
        """Return the point at the distances `north`, `east` and `up`, in metres.

        Negative ones are south, west, down.
        """
        latitude = self.latitude + math.degrees(north / geo.EARTH_RADIUS)
        turn = east / (geo.EARTH_RADIUS * max(1e-6, math.cos(math.radians(self.latitude))))
        return Place(latitude, self.longitude + math.degrees(turn), self.altitude + up)


class Vehicle:
    """The state of one vehicle as its messages show it."""

    def __init__(self, modes: ModeTable) -> None:
        self.modes = modes
        """Of the kind that the vehicle reports, once it has."""
        self.declared = modes
        """Of the kind that the manifest declares."""
        self.type = dialect.MAV_TYPE_GENERIC
        """MAV_TYPE of its HEARTBEAT."""
        self.autopilot: int | None = None
        """MAV_AUTOPILOT of its HEARTBEAT; None before the first."""
        self.not_commanded = ""
        """Why nothing may be sent to it that commands or configures it; empty if it may."""
        self.connected = False
        """Heard within the link-loss time; set by the session."""
        self.heartbeats = 0
        """Count of HEARTBEATs, for "still at the next HEARTBEAT"."""
        self.heard_at = -math.inf
        """Time of the last HEARTBEAT."""
        self.mode = -1
        self._unwanted_mode = -1
        """A mode in which a failsafe of its own flies it, as somebody wants another (CURRENT_MODE); -1 = none."""
        self.held_by_failsafe_at = -math.inf
        """When a failsafe of its own began to hold it, until that is over or an agent has taken control."""
        self._failsafe_after = -1
        """After which HEARTBEAT, by count, it reported last that a failsafe of its own acts from then on."""
        self.overridden = False
        """Whether others set the present mode; set by the control authority."""
        self.armed = False
        self.base_mode = 0
        """MAV_MODE_FLAG bits of its HEARTBEAT."""
        self.system_status = 0
        """MAV_STATE of its HEARTBEAT."""
        self.landed_state = 0
        self.landed_at = -math.inf
        """When it was reported last."""
        self.now = 0.0
        """Time of its last message."""
        self.stale_after = 5.0
        """Mission seconds after which its reported position is stale; set by the session."""
        self.prearm_ok = False
        self._unhealthy = 0
        self.ekf_flags = 0
        self.gps_fix = 0
        self.home: Place | None = None
        """AMSL."""
        self.position: Place | None = None
        """Metres above home."""
        self.positions = 0
        """Count of position messages."""
        self.position_at = -math.inf
        """Time of the last one."""
        self.amsl = 0.0
        self.heading: float | None = None
        """Radians from north, clockwise."""
        self.speed = 0.0
        """m/s, over all three axes."""
        self.target: Place | None = None
        """The vehicle's own target (message 87), AMSL."""
        self.targets = 0
        """Count of such messages."""
        self.reached = -1
        """The item of the mission that it reported last as reached; -1 = none."""
        self.reached_again = False
        """Whether the last such report repeats the one before, as PX4's does each second."""
        self.payload_heard_at = dict.fromkeys((*CAMERAS, *GIMBALS), -math.inf)
        """When each camera or gimbal that is a component of its system was heard last; nothing of it is its state."""
        self.reboots = 0
        self._boot_ms, self._boot_ms_at = 0, -math.inf

    @property
    def mode_name(self) -> str:
        """Name of the mode; empty before the first HEARTBEAT."""
        if self.overridden and self.mode == self.modes.guided and self.modes.guided_by_others:
            return self.modes.guided_by_others
        if self.mode in self.modes.also_guided and not self.overridden:
            return self.modes.name(self.modes.guided)
        return self.modes.name(self.mode) if self.mode >= 0 else ""

    @property
    def aloft(self) -> bool:
        """Whether it is off the ground: by EXTENDED_SYS_STATE, or by its height without that.

        A vehicle that never leaves the ground counts as aloft while it is armed: it may be moving.
        """
        if self.modes.ground:
            return self.armed
        if self.landed_state == dialect.MAV_LANDED_STATE_UNDEFINED or self._stale(self.landed_at):
            return self.armed and self.position is not None and self.position.altitude > OFF_GROUND
        return self.armed and self.landed_state in ALOFT

    @property
    def on_ground(self) -> bool:
        """Whether it reports to be on the ground, and not long ago."""
        return self.landed_state == ON_GROUND and not self._stale(self.landed_at)

    @property
    def located(self) -> bool:
        """Whether it has reported where it is, and whether it flies, since it was heard first."""
        return self.position is not None and self.landed_at > -math.inf

    @property
    def placed(self) -> bool:
        """Whether its position is not stale."""
        return self.position is not None and not self._stale(self.position_at)

    def _stale(self, at: float) -> bool:
        return self.now - at > self.stale_after

    def receive(self, message: dialect.MAVLink_message, now: float) -> None:
        """Take in one message of this vehicle's autopilot."""
        self.now = now
        if (boot_ms := getattr(message, "time_boot_ms", None)) is not None:
            wrapped = boot_ms + 2**32 - self._boot_ms <= (now - self._boot_ms_at) * 1000 + REBOOT_MS
            if boot_ms + REBOOT_MS < self._boot_ms and not wrapped:
                self._rebooted()
            self._boot_ms = boot_ms if wrapped else max(boot_ms, self._boot_ms)
            self._boot_ms_at = now
        match message.get_type():
            case "HEARTBEAT":
                self.heartbeats += 1
                self.heard_at = now
                self.mode = message.custom_mode
                if (message.type, message.autopilot) != (self.type, self.autopilot):
                    self.type, self.autopilot = message.type, message.autopilot
                    self.not_commanded = _not_commanded(message.autopilot)
                    self.modes = table_of(self.declared, message.autopilot, message.type)
                if message.system_status == dialect.MAV_STATE_BOOT and self.system_status > dialect.MAV_STATE_BOOT:
                    self._rebooted()
                self.base_mode, self.system_status = message.base_mode, message.system_status
                booting = self.system_status == dialect.MAV_STATE_BOOT  # by a watchdog in flight: it may go on armed
                self.armed = bool(message.base_mode & _ARMED) or (self.armed and booting)
                critical = self.system_status == dialect.MAV_STATE_CRITICAL
                if not critical and now > self.held_by_failsafe_at + CRITICAL_WITHIN:
                    self.held_by_failsafe_at = -math.inf
            case "CURRENT_MODE":
                wanted = message.intended_custom_mode in (0, message.custom_mode)
                self._unwanted_mode = -1 if wanted else message.custom_mode
            case "EVENT" if acts(message):
                self._failsafe_after = self.heartbeats
                if holds(message):
                    self.held_by_failsafe_at = now
            case "GLOBAL_POSITION_INT":
                self.position = Place(message.lat / 1e7, message.lon / 1e7, message.relative_alt / 1e3)
                self.amsl = message.alt / 1e3
                self.heading = None if message.hdg == UNKNOWN_HEADING else math.radians(message.hdg / 100)
                self.speed = math.hypot(message.vx, message.vy, message.vz) / 100
                self.positions += 1
                self.position_at = now
            case "POSITION_TARGET_GLOBAL_INT":
                self.target = Place(message.lat_int / 1e7, message.lon_int / 1e7, message.alt)
                self.targets += 1
            case "SYS_STATUS":
                self.prearm_ok = bool(message.onboard_control_sensors_health & _PREARM_CHECK)
                there = message.onboard_control_sensors_present & message.onboard_control_sensors_enabled
                self._unhealthy = there & ~message.onboard_control_sensors_health
            case "EKF_STATUS_REPORT" | "ESTIMATOR_STATUS":
                self.ekf_flags = message.flags
            case "GPS_RAW_INT":
                self.gps_fix = message.fix_type
            case "MISSION_ITEM_REACHED":
                self.reached_again, self.reached = message.seq == self.reached, message.seq
            case "MISSION_CURRENT" if message.seq < self.reached:
                self.reached = -1
            case "EXTENDED_SYS_STATE":
                self.landed_state, self.landed_at = message.landed_state, now
            case "HOME_POSITION":
                self.home = Place(message.latitude / 1e7, message.longitude / 1e7, message.altitude / 1e3)

    @property
    def unhealthy(self) -> list[str]:
        """The sensors that are enabled and not healthy (SYS_STATUS), such as `3D_MAG`."""
        sensors = dialect.enums["MAV_SYS_STATUS_SENSOR"].items()
        names = {bit: entry.name.removeprefix("MAV_SYS_STATUS_").removeprefix("SENSOR_") for bit, entry in sensors}
        return [name for bit, name in names.items() if bit & self._unhealthy and bit != _PREARM_CHECK]

    @property
    def contradiction(self) -> str:
        """That the vehicle is another kind than the manifest declares, for people; empty if it is not."""
        return "" if self.not_commanded else contradiction(self.declared, self.type)

    @property
    def failsafe_acts(self) -> bool:
        """Whether the vehicle reports that a failsafe of its own flies it, against what was set or in the same mode.

        CRITICAL alone is no failsafe: PX4 reports it for a warning too, such as a low battery, and flies on.
        """
        if self.system_status != dialect.MAV_STATE_CRITICAL or not self.armed:
            return self.armed and self.system_status in GOES_DOWN
        return self.mode == self._unwanted_mode or self.held_by_failsafe_at > -math.inf

    @property
    def failsafe_announced(self) -> bool:
        """Whether a failsafe of its own has begun since its last HEARTBEAT: the next one shows the mode."""
        return self._failsafe_after == self.heartbeats

    def state(self) -> dict[str, object]:
        """The content of its last HEARTBEAT; empty while it is not heard."""
        heard = self.connected
        return {
            "mode": self.mode_name if heard else "",
            "connected": heard,
            "armed": self.armed and heard,
            "guided": heard and bool(self.base_mode & dialect.MAV_MODE_FLAG_GUIDED_ENABLED),
            "manual_input": heard and bool(self.base_mode & dialect.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED),
            "system_status": self.system_status if heard else 0,
        }

    def not_ready(self) -> list[str]:
        """Why arming would be refused or flying in this mode would not work, for people; empty = ready."""
        missing = []
        if not self.connected:
            missing.append("no heartbeat from the vehicle")
        if not self.prearm_ok:
            sensors = ", ".join(self.unhealthy)
            missing.append(f"pre-arm checks have not passed (SYS_STATUS{sensors and f': not healthy: {sensors}'})")
        if self.mode not in self.modes.without_position:
            if self.gps_fix < dialect.GPS_FIX_TYPE_3D_FIX:
                missing.append(f"no GPS position (fix type {self.gps_fix})")
            if not self.ekf_flags & _POS_HORIZ_ABS:
                missing.append(f"the estimator has no position yet (EKF flags {self.ekf_flags})")
            if self.home is None:
                missing.append("home is not known")
        return missing

    def _rebooted(self) -> None:
        """Forget what it reported: it is booting (MAV_STATE_BOOT), or its clock went back."""
        self.reboots += 1
        self._boot_ms = 0
        self.landed_state, self.prearm_ok, self.ekf_flags, self.gps_fix = 0, False, 0, 0
        self.home = self.target = None


def _not_commanded(autopilot: int) -> str:
    """Return why an autopilot (MAV_AUTOPILOT) is not commanded; empty for ArduPilot and PX4.

    Mode numbers, the frames of altitudes and what an acknowledgement means differ between autopilots.
    """
    if autopilot in (dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, dialect.MAV_AUTOPILOT_PX4):
        return ""
    entry = dialect.enums["MAV_AUTOPILOT"].get(autopilot)
    name = entry.name.removeprefix("MAV_AUTOPILOT_") if entry else f"MAV_AUTOPILOT {autopilot}"
    return f"the autopilot of the vehicle is {name}, and only ArduPilot and PX4 are commanded: it is listened to only"
