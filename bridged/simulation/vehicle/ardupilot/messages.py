"""The MAVLink side of a simulated ArduPilot: its messages, and the mission protocol."""

import math
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.ardupilot import telemetry
from bridged.simulation.vehicle.ardupilot.ardupilot import ArduPilot
from bridged.simulation.vehicle.ardupilot.boot import Milestone
from bridged.simulation.vehicle.ardupilot.commands import CommandContext, global_setpoint, local_setpoint
from bridged.simulation.vehicle.ardupilot.mission import KNOWN, goal_of
from bridged.simulation.vehicle.command_messages import Command
from bridged.simulation.vehicle.log_transfer import LOG_MESSAGES, LogTransfer, dataflash_log
from bridged.simulation.vehicle.messages import Channel, MessageHandler, Messages, Streams, parameter_name
from bridged.simulation.vehicle.mission_items import Item
from bridged.simulation.vehicle.mission_protocol import (
    MISSION,
    Ack,
    MissionProtocol,
    Peer,
    ack,
    parameters_of,
    peer_of,
)
from bridged.simulation.vehicle.motion.tasks import GoTo
from bridged.simulation.vehicle.notifications import (
    Event,
    HomeChanged,
    ModeChanged,
    Severity,
    Text,
)
from bridged.simulation.vehicle.parameters import Parameter

TIMESYNC_PERIOD_S = 10.0

HEARTBEAT = 0

_NO_INDEX = 65535


class ArduPilotMessages(MessageHandler[ArduPilot]):
    """The messages of one ArduPilot."""

    def __init__(self, autopilot: ArduPilot) -> None:
        super().__init__(autopilot, telemetry.BUILDERS)
        self._mission = ArduPilotMissions(autopilot)
        self._next_timesync = TIMESYNC_PERIOD_S

    def streams(self) -> Streams:
        """Return the streams of a new link."""
        return Streams(telemetry.BUILDERS, self.autopilot.DEFAULTS_S)

    def sends(self, message: int) -> bool:
        """Return whether a stream is sent at all now, by message id."""
        return message == HEARTBEAT or self.autopilot.passed(Milestone.READY)

    def continued(self) -> Messages:
        """Return the requests of an upload."""
        return self._mission.advance()

    def regular(self) -> Messages:
        """Return a TIMESYNC when it is time."""
        if self.autopilot.now < self._next_timesync:
            return []
        self._next_timesync += TIMESYNC_PERIOD_S
        return [dialect.MAVLink_timesync_message(0, round(self.autopilot.now * 1e9))]

    def notify(self, event: Event, channels: list[Channel]) -> None:
        """Send a notification on every channel; STATUSTEXT only where a peer was heard (recorded)."""
        messages = self._messages_of(event)
        for channel in channels:
            if channel.heard or not isinstance(event, Text):
                channel.outbox += messages

    def _messages_of(self, event: Event) -> Messages:
        match event:
            case Text(severity, text):
                return [dialect.MAVLink_statustext_message(severity, text.encode()[:50])]
            case ModeChanged():
                return [telemetry.heartbeat(self.autopilot)]
            case HomeChanged():
                both = (telemetry.BUILDERS[number](self.autopilot) for number in (49, 242))
                return [message for message in both if message is not None]
        return self.news(event)

    def answer(self, message: dialect.MAVLink_message, channel: Channel) -> Messages:
        """Answer a message of another system."""
        kind, ardupilot = message.get_type(), self.autopilot
        match kind:
            case "HEARTBEAT":
                ardupilot.station.heartbeat(message.get_srcSystem(), ardupilot.now)
            case "COMMAND_LONG" | "COMMAND_INT":
                return self._command(Command.of(message), channel)
            case "SET_MODE":
                if message.base_mode & 1:  # never acknowledged (recorded)
                    ardupilot.set_mode(message.custom_mode)
            case "SET_POSITION_TARGET_GLOBAL_INT":
                global_setpoint(ardupilot, message)
            case "SET_POSITION_TARGET_LOCAL_NED":
                local_setpoint(ardupilot, message)
            case "RC_CHANNELS_OVERRIDE":
                ardupilot.transmitter.override(message, ardupilot.now)
            case "REQUEST_DATA_STREAM":
                group, rate = message.req_stream_id, message.req_message_rate
                telemetry.request_group(channel.streams, group, rate, ardupilot.now, on=bool(message.start_stop))
            case "TIMESYNC" if message.tc1 == 0:
                return self.time_sync(message)
            case "PARAM_REQUEST_READ" | "PARAM_REQUEST_LIST" | "PARAM_SET":
                return self._parameter(message, kind, channel)
            case _ if kind.startswith("MISSION_"):
                return self._mission.receive(message)
            case _ if kind in LOG_MESSAGES:
                log = dataflash_log((one.name, one.value) for one in ardupilot.parameters)
                return LogTransfer([log]).receive(message, armed=ardupilot.armed)
        return []

    def _command(self, command: Command, channel: Channel) -> Messages:
        context = CommandContext(self.autopilot, channel.streams)
        result = context.carry_out(command)
        ack = dialect.MAVLink_command_ack_message(command.number, int(result), 0, 0, *command.peer)
        self.reboots |= context.reboot_wanted
        return [*context.ahead, ack, *context.after]

    def _parameter(self, message: dialect.MAVLink_message, kind: str, channel: Channel) -> Messages:
        parameters = self.autopilot.parameters
        if kind == "PARAM_REQUEST_LIST":
            channel.list_at = 0
            return []
        if kind == "PARAM_REQUEST_READ" and message.param_index >= 0:
            found, named = parameters.at(message.param_index), False
        else:
            name = parameter_name(message)
            if kind == "PARAM_SET" and name in parameters:
                parameters.set(name, message.param_value)
            found, named = parameters.find(name), True
        return [self.value_of(found, named=named)] if found is not None else []

    def value_of(self, parameter: Parameter, *, named: bool = False) -> dialect.MAVLink_message:
        """Return the PARAM_VALUE of a parameter; one that is `named` has no index."""
        index = _NO_INDEX if named else parameter.index
        return dialect.MAVLink_param_value_message(
            parameter.name.encode(), parameter.value, parameter.kind, len(self.autopilot.parameters), index
        )


_GUIDED_ITEM = 2
"""MISSION_ITEM.current of a goal for GUIDED that is not part of a mission (dronekit's simple_goto)."""


class ArduPilotMissions(MissionProtocol[ArduPilot]):
    """Missions of which item 0 is home; fences and rally points are stored, and have no effect."""

    REPEAT_S: ClassVar = 1.0
    GIVE_UP_S: ClassVar = 8.0
    MAX_ITEMS: ClassVar = 700
    COMMANDS: ClassVar = KNOWN
    BUSY: ClassVar = Ack.UNSUPPORTED
    NOT_STORED: ClassVar = Ack.UNSUPPORTED
    REQUEST: ClassVar = dialect.MAVLink_mission_request_message

    def __init__(self, autopilot: ArduPilot) -> None:
        super().__init__(autopilot)
        self._others: dict[int, list[Item]] = {}
        """Fence and rally points, by mission_type."""

    def receive(self, message: dialect.MAVLink_message) -> Messages:
        """Answer one message of the mission protocol, or one goal for GUIDED."""
        if message.get_type() in ("MISSION_ITEM", "MISSION_ITEM_INT") and message.current == _GUIDED_ITEM:
            return [ack(peer_of(message), Ack.ACCEPTED if self._guide(message) else Ack.INVALID)]
        return super().receive(message)

    def _count(self, kind: int) -> int:
        if kind != MISSION:
            return len(self._others.get(kind, ()))
        return len(self.autopilot.mission.items) + (self.autopilot.home is not None)

    def _item(self, seq: int, kind: int) -> tuple[Item, bool] | None:
        if kind != MISSION:
            return next(((item, False) for item in self._others.get(kind, ()) if item.seq == seq), None)
        mission, home = self.autopilot.mission, self.autopilot.home
        if seq == 0 and home is not None:
            where = (home.lat_e7, home.lon_e7, home.alt)
            return Item(0, 0, dialect.MAV_CMD_NAV_WAYPOINT, (0, 0, 0, 0), *where), False
        item = mission.item(seq)
        return None if item is None else (item, seq == mission.current)

    def _store(self, items: list[Item], kind: int) -> None:
        if kind != MISSION:
            self._others[kind] = items
            return
        self.autopilot.mission.store(items)
        if items:
            self.autopilot.send_text("Flight plan received")
        else:
            self.autopilot.count_mission(0)

    def _partly_stored(self, count: int) -> None:
        if count > 1:
            self.autopilot.count_mission(count)

    def _given_up(self, peer: Peer) -> Messages:
        self.autopilot.send_text("Mission upload timeout", Severity.WARNING)
        return [ack(peer, Ack.CANCELLED)]

    def _set_current(self, seq: int) -> Messages:
        return [telemetry.mission_current(self.autopilot)] if self.autopilot.jump_to(seq) else []

    def _read(self, message: dialect.MAVLink_message) -> Item | Ack:
        x, y = message.x, message.y
        if message.get_type() == "MISSION_ITEM":
            if not (math.isfinite(x) and math.isfinite(y) and abs(x) <= 180 and abs(y) <= 180):
                return Ack.INVALID
            x, y = round(x * 1e7), round(y * 1e7)
        if not math.isfinite(message.z) or abs(message.z) > 100_000:
            return Ack.INVALID
        if not self._knows(message):
            return Ack.UNSUPPORTED
        params = (*parameters_of(message), 0.0)
        if message.command == dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH:  # stored without a place (recorded)
            return Item(message.seq, 0, message.command, params, 0, 0, 0.0)
        auto = int(bool(message.autocontinue))
        return Item(message.seq, message.frame, message.command, params, x, y, message.z, auto)

    def _guide(self, message: dialect.MAVLink_message) -> bool:
        """Fly to the place of an item in GUIDED; returns whether it does."""
        item, vehicle = self._read(message), self.autopilot
        goal = None if isinstance(item, Ack) else goal_of(item, vehicle.chart, vehicle.home or vehicle.chart.origin)
        return goal is not None and vehicle.mode is vehicle.MODES.GUIDED and vehicle.guide(GoTo(goal))
