"""A plane or rover as far as messages go: it answers as a script says and moves in straight lines. No simulation."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.vehicle.flight_modes import ModeTable
from bridged.drivers.mavlink.vehicle.state import Place
from tests.bridged.sky import HOME, Message

SEND_EVERY = 0.2


class Scripted:
    """Takes the place of the simulated copter in a `Sky`."""

    system = 1

    def __init__(self, kind: int, modes: ModeTable, *, speed: float = 10.0, grounded: bool = False) -> None:
        self.kind, self.modes, self.speed, self.grounded = kind, modes, speed, grounded
        self.mode, self.armed = 0, False
        self.home = Place(HOME.lat, HOME.lon, HOME.alt)
        self.at = Place(HOME.lat, HOME.lon, 0.0)
        self.goal: Place | None = None
        self.parameters = {"TKOFF_ALT": 30.0, "FS_GCS_ENABLE": 1.0}
        self.now = 0.0
        self._next = 0.0
        self._moving = False

    @property
    def age(self) -> float:
        """Seconds since it is there."""
        return self.now

    def receive(self, message: Message) -> list[Message]:
        """Answer one message."""
        match message.get_type():
            case "COMMAND_LONG" | "COMMAND_INT":
                answers = self._command(message)
                if answers is None:
                    return [self._ack(message, dialect.MAV_RESULT_UNSUPPORTED)]
                return [self._ack(message, dialect.MAV_RESULT_ACCEPTED), *answers]
            case "SET_POSITION_TARGET_GLOBAL_INT" if self.mode == self.modes.guided:
                self.goal = Place(message.lat_int / 1e7, message.lon_int / 1e7, message.alt)
            case "PARAM_REQUEST_READ" if message.param_id in self.parameters:
                return [self._parameter(message.param_id)]
            case "PARAM_SET" if message.param_id in self.parameters:
                self.parameters[message.param_id] = message.param_value
                return [self._parameter(message.param_id)]
        return []

    def advance(self, dt: float) -> list[Message]:
        """Let time pass."""
        self.now += dt
        self._move(dt)
        if self.now < self._next:
            return []
        self._next = self.now + SEND_EVERY
        return self._telemetry()

    def _command(self, message: Message) -> list[Message] | None:
        match message.command:
            case dialect.MAV_CMD_DO_SET_MODE:
                self.mode = int(message.param2)
            case dialect.MAV_CMD_COMPONENT_ARM_DISARM:
                self.armed = message.param1 == 1
            case dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH:
                self.mode = self.modes.rtl
            case dialect.MAV_CMD_DO_REPOSITION if message.get_type() == "COMMAND_INT":
                self.mode = self.modes.guided
                self.goal = Place(message.x / 1e7, message.y / 1e7, message.z)
            case dialect.MAV_CMD_SET_MESSAGE_INTERVAL | dialect.MAV_CMD_RUN_PREARM_CHECKS:
                pass
            case dialect.MAV_CMD_REQUEST_MESSAGE if message.param1 == dialect.MAVLINK_MSG_ID_HOME_POSITION:
                return [self._home()]
            case _:
                return None
        return []

    def _move(self, dt: float) -> None:
        goal = self.goal if self.mode == self.modes.guided else None
        if self.mode == self.modes.rtl:
            goal = Place(self.home.latitude, self.home.longitude, self.at.altitude)
        if self.mode == self.modes.takeoff:
            goal = Place(self.at.latitude, self.at.longitude, self.parameters["TKOFF_ALT"])
        self._moving = False
        if goal is None or not self.armed:
            return
        away = max(self.at.distance(goal), abs(goal.altitude - self.at.altitude))
        if away < self.speed * dt:
            return
        self._moving, share = True, self.speed * dt / away
        self.at = Place(
            self.at.latitude + (goal.latitude - self.at.latitude) * share,
            self.at.longitude + (goal.longitude - self.at.longitude) * share,
            self.at.altitude + (goal.altitude - self.at.altitude) * share,
        )

    def _telemetry(self) -> list[Message]:
        ms, lat, lon = round(self.now * 1000), round(self.at.latitude * 1e7), round(self.at.longitude * 1e7)
        above, mode_bits = round(self.at.altitude * 1e3), 1 | (128 if self.armed else 0)
        speed = round(self.speed * 100) if self._moving or (self.at.altitude > 1 and not self.modes.can_stop) else 0
        landed = 0 if self.grounded else 2 if self.at.altitude > 1 else 1
        health = dialect.MAV_SYS_STATUS_PREARM_CHECK
        sent = [
            dialect.MAVLink_global_position_int_message(
                ms, lat, lon, round(HOME.alt * 1e3) + above, above, speed, 0, 0, 0
            ),
            dialect.MAVLink_sys_status_message(health, health, health, 0, 12000, 0, 90, 0, 0, 0, 0, 0, 0),
            dialect.MAVLink_ekf_status_report_message(831, 0, 0, 0, 0, 0),
            dialect.MAVLink_gps_raw_int_message(0, 3, lat, lon, 0, 0, 0, 0, 0, 10),
            dialect.MAVLink_extended_sys_state_message(0, landed),
            dialect.MAVLink_vfr_hud_message(15, speed / 100, 0, 0, self.at.altitude, 0),
            dialect.MAVLink_battery_status_message(0, 0, 0, 0, [12000] + [65535] * 9, 0, 0, 0, 90),
            dialect.MAVLink_mission_current_message(0, 0, 1, 0),
        ]
        if math.floor(self.now) != math.floor(self.now - SEND_EVERY):
            sent.insert(0, dialect.MAVLink_heartbeat_message(self.kind, 3, mode_bits, self.mode, 4, 3))
        if self.goal is not None and self.mode == self.modes.guided:
            goal = self.goal
            sent.append(
                dialect.MAVLink_position_target_global_int_message(
                    ms, 0, 0, round(goal.latitude * 1e7), round(goal.longitude * 1e7), HOME.alt + goal.altitude,
                    *(0,) * 8,
                )
            )  # fmt: skip
        return sent

    def _home(self) -> Message:
        lat, lon, alt = round(HOME.lat * 1e7), round(HOME.lon * 1e7), round(HOME.alt * 1e3)
        return dialect.MAVLink_home_position_message(lat, lon, alt, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)

    def _parameter(self, name: str) -> Message:
        return dialect.MAVLink_param_value_message(name.encode(), self.parameters[name], 9, 2, 0)

    def _ack(self, message: Message, result: int) -> Message:
        return dialect.MAVLink_command_ack_message(
            message.command, result, 0, 0, message.get_srcSystem(), message.get_srcComponent()
        )
