"""The MAVLink side of a simulated PX4: its messages, and the mission protocol for missions, fences and rally points."""

from __future__ import annotations

import math
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport import further_messages
from bridged.simulation.vehicle.command_messages import Command
from bridged.simulation.vehicle.log_transfer import LOG_MESSAGES, LogTransfer, ulog
from bridged.simulation.vehicle.messages import Channel, MessageHandler, Messages, Streams, parameter_name
from bridged.simulation.vehicle.mission_items import Item, whole
from bridged.simulation.vehicle.mission_protocol import (
    FENCE,
    MISSION,
    RALLY,
    Ack,
    MissionProtocol,
    Peer,
    parameters_of,
    peer_of,
)
from bridged.simulation.vehicle.notifications import (
    Done,
    Event,
    MissionChanged,
    Number,
    ParameterChanged,
    Text,
)
from bridged.simulation.vehicle.parameters import Kind, Parameter
from bridged.simulation.vehicle.px4 import missions, telemetry
from bridged.simulation.vehicle.px4.commands import CommandContext, global_setpoint, local_setpoint, set_mode
from bridged.simulation.vehicle.px4.parameters import NO_SUCH, WRONG_TYPE, decoded, encoded
from bridged.simulation.vehicle.px4.px4 import Px4
from bridged.simulation.vehicle.px4.state import HEARTBEAT_TIMEOUT_S
from bridged.simulation.vehicle.px4.texts import CRITICAL

TEXT_KEPT_S = 4.0
"""Vehicle seconds that a text waits for a ground station on a link (recorded: 2.1 were waited, 6 were not)."""
STATION_NOTICED_S = 0.55
"""Vehicle seconds from the first HEARTBEAT of a ground station on a link to the first text (recorded: 0.1 to 1.1)."""
_ANNOUNCED_S = 0.02
"""Vehicle seconds after which a changed parameter is announced to all."""
_TO_NOBODY = frozenset((420,))
"""Commands whose acknowledgement has no target (recorded): INJECT_FAILURE."""
_CHUNK = 50
"""Bytes of one STATUSTEXT."""
_NO_INDEX, _ALL = -1, 0
_ERROR_INDEX = 10080
"""param_index of PARAM_ERROR (recorded)."""


class Px4Messages(MessageHandler[Px4]):
    """The messages of one PX4."""

    def __init__(self, autopilot: Px4) -> None:
        super().__init__(autopilot, telemetry.BUILDERS)
        self._mission = Px4Missions(autopilot)
        self._later: list[tuple[float, Event]] = []
        """What is sent at a time (vehicle seconds)."""
        self._texts = self._events = 0

    def streams(self) -> Streams:
        """Return the streams of a new link."""
        return Streams(telemetry.STREAMS, telemetry.DEFAULTS_S)

    def sends(self, message: int) -> bool:
        """Return whether a stream is simulated."""
        return message in telemetry.BUILDERS

    def continued(self) -> Messages:
        """Return the requests of an upload; queue what was to come later."""
        now = self.autopilot.now
        due = [event for at, event in self._later if at <= now]
        if due:
            self._later = [one for one in self._later if one[0] > now]
            self.autopilot.events += due
        return self._mission.advance()

    @property
    def waits(self) -> bool:
        """Whether an upload or something that takes its time goes on."""
        return bool(self._later) or self._mission.uploading

    def notify(self, event: Event, channels: list[Channel]) -> None:
        """Send a notification on every channel; STATUSTEXT only where a ground station is heard."""
        if isinstance(event, Text):
            for channel in channels:
                channel.held.append((self.autopilot.now, event.text, int(event.severity)))
                self._release(channel)
            return
        messages = self._messages_of(event)
        for channel in channels:
            channel.outbox += messages

    def streamed(self, channel: Channel, now: float) -> Messages:
        """Return the streams of a channel that are due, and texts that waited."""
        if channel.held:
            self._release(channel)
        return super().streamed(channel, now)

    def _release(self, channel: Channel) -> None:
        now = self.autopilot.now
        channel.held = [one for one in channel.held if now - one[0] <= TEXT_KEPT_S]
        if not self._present(channel) or now - channel.station_since < STATION_NOTICED_S:
            return
        held, channel.held = channel.held, []
        for _, text, severity in held:
            channel.outbox += self._text(text, severity)

    def _present(self, channel: Channel) -> bool:
        at = channel.station_at
        return at is not None and self.autopilot.now - at <= HEARTBEAT_TIMEOUT_S

    def _text(self, text: str, severity: int) -> Messages:
        self._texts = self._texts % 65535 + 1
        raw = text.encode()
        pieces = [raw[at : at + _CHUNK] for at in range(0, len(raw), _CHUNK)]
        return [
            dialect.MAVLink_statustext_message(severity, piece, self._texts, number)
            for number, piece in enumerate(pieces)
        ]

    def _messages_of(self, event: Event) -> Messages:
        px4 = self.autopilot
        match event:
            case MissionChanged():
                return [telemetry.mission_current(px4)]
            case Number(number, levels, arguments):
                self._events = (self._events + 1) % 65536
                at = round(px4.now * 1000) % 2**32
                return [further_messages.Event(number, at, self._events, 0, 0, levels, [*arguments.ljust(40, b"\0")])]
            case Done(command, result, peer):
                return [self._ack(command, int(result), peer)]
        return self.news(event)

    def answer(self, message: dialect.MAVLink_message, channel: Channel) -> Messages:
        """Answer a message of another system."""
        kind, px4 = message.get_type(), self.autopilot
        if getattr(message, "target_component", _ALL) not in (_ALL, 1):
            return []
        match kind:
            case "HEARTBEAT":
                px4.links.heard(message, int(px4.parameters["MAV_SYS_ID"]), px4.now)
                if message.type == dialect.MAV_TYPE_GCS:
                    if not self._present(channel):
                        channel.station_since = px4.now
                    channel.station_at = px4.now
            case "COMMAND_LONG" | "COMMAND_INT":
                return self._command(Command.of(message), channel)
            case "SET_MODE":
                result = set_mode(px4, whole(message.custom_mode) >> 16 & 0xFF, whole(message.custom_mode) >> 24)
                return [self._ack(dialect.MAV_CMD_DO_SET_MODE, int(result), peer_of(message))]
            case "SET_POSITION_TARGET_GLOBAL_INT":
                global_setpoint(px4, message)
            case "SET_POSITION_TARGET_LOCAL_NED":
                local_setpoint(px4, message)
            case "MANUAL_CONTROL" if message.target in (0, int(px4.parameters["MAV_SYS_ID"])):
                px4.sticks.move(message.x, message.y, message.z, message.r, px4.now)
            case "TIMESYNC" if message.tc1 == 0:
                return self.time_sync(message)
            case "PARAM_REQUEST_LIST":
                channel.list_at = 0
            case "PARAM_REQUEST_READ":
                return self._read_parameter(message)
            case "PARAM_SET":
                return self._set_parameter(message)
            case _ if kind.startswith("MISSION_"):
                return self._mission.receive(message)
            case _ if kind in LOG_MESSAGES:
                values = ((one.name, one.value, one.kind is Kind.INT32) for one in px4.parameters)
                return LogTransfer([ulog(values)], first=0).receive(message, armed=px4.armed)
        return []

    def _command(self, command: Command, channel: Channel) -> Messages:
        context = CommandContext(self.autopilot, channel.streams)
        result = context.carry_out(command)
        self._later += [(self.autopilot.now + seconds, done) for seconds, done in context.later]
        peer = (0, 0) if command.number in _TO_NOBODY else command.peer
        return [*context.ahead, self._ack(command.number, int(result), peer)]

    def _ack(self, command: int, result: int, peer: tuple[int, int]) -> dialect.MAVLink_message:
        return dialect.MAVLink_command_ack_message(command, result, 0, 0, *peer)

    def _read_parameter(self, message: dialect.MAVLink_message) -> Messages:
        parameters, index = self.autopilot.parameters, message.param_index
        found = parameters.at(index) if index >= 0 else parameters.find(parameter_name(message))
        return [self.value_of(found)] if found is not None else [self._error(message, NO_SUCH)]

    def _set_parameter(self, message: dialect.MAVLink_message) -> Messages:
        parameters, name = self.autopilot.parameters, parameter_name(message)
        found = parameters.find(name)
        if found is None:
            return [self._error(message, NO_SUCH)]
        if message.param_type != found.kind:
            return [self._error(message, WRONG_TYPE)]
        if parameters.set(name, decoded(message.param_value, message.param_type)):
            self._later.append((self.autopilot.now + _ANNOUNCED_S, ParameterChanged(name)))
        found = parameters.find(name)
        return [self.value_of(found)] if found is not None else []

    def _error(self, message: dialect.MAVLink_message, error: int) -> dialect.MAVLink_message:
        return dialect.MAVLink_param_error_message(
            *peer_of(message), parameter_name(message).encode(), _ERROR_INDEX, error
        )

    def value_of(self, parameter: Parameter, *, named: bool = False) -> dialect.MAVLink_message:
        """Return the PARAM_VALUE of a parameter, always with its index."""
        return dialect.MAVLink_param_value_message(
            parameter.name.encode(), encoded(parameter.value, parameter.kind), int(parameter.kind),
            len(self.autopilot.parameters), parameter.index,
        )  # fmt: skip


_FRAMES = frozenset((0, 2, 3, 5, 6))
"""Frames of items that are taken: places on the earth, and none."""


class Px4Missions(MissionProtocol[Px4]):
    """Missions whose items count from 0, without home, fences, and rally points, which have no effect."""

    REPEAT_S: ClassVar = 0.25
    GIVE_UP_S: ClassVar = 5.06
    MAX_ITEMS: ClassVar = 500
    COMMANDS: ClassVar = missions.KNOWN
    BUSY: ClassVar = Ack.DENIED
    NOT_STORED: ClassVar = Ack.BAD_SEQUENCE
    REQUEST: ClassVar = dialect.MAVLink_mission_request_int_message

    def __init__(self, autopilot: Px4) -> None:
        super().__init__(autopilot)
        self._rally: list[Item] = []

    def receive(self, message: dialect.MAVLink_message) -> Messages:
        """Answer one message of the mission protocol; those in degrees are ignored."""
        return [] if message.get_type() in ("MISSION_ITEM", "MISSION_REQUEST") else super().receive(message)

    def _items(self, kind: int) -> list[Item]:
        return {MISSION: self.autopilot.missions.items, FENCE: self.autopilot.fence.items}.get(kind, self._rally)

    def _count(self, kind: int) -> int:
        return len(self._items(kind))

    def _item(self, seq: int, kind: int) -> tuple[Item, bool] | None:
        items, current = self._items(kind), self.autopilot.missions.current if kind == MISSION else 0
        return (items[seq], seq == current) if 0 <= seq < len(items) else None

    def _store(self, items: list[Item], kind: int) -> None:
        px4 = self.autopilot
        if kind == FENCE:
            px4.fence.items = items
        elif kind == RALLY:
            self._rally = items
        elif kind == MISSION:
            px4.missions.store(items, keep_current=px4.flight.airborne)
        px4.navigator.judge()
        if kind == MISSION and items:
            px4.navigator.replaced()
        px4.events.append(MissionChanged())

    def _refused(self) -> None:
        self.autopilot.send_text("IGN MISSION_ITEM: Invalid item", CRITICAL)

    def _given_up(self, peer: Peer) -> Messages:
        self.autopilot.send_text("Mission sync timeout", CRITICAL)
        return []

    def _set_current(self, seq: int) -> Messages:
        if not self.autopilot.navigator.jump_to(seq):
            self.autopilot.send_text("WPM: WP CURR CMD: Not in list", CRITICAL)
        return []

    def _read(self, message: dialect.MAVLink_message) -> Item | Ack:
        fenced = message.mission_type == FENCE
        if message.frame not in _FRAMES:
            return Ack.BAD_FRAME
        if not self._knows(message):
            return Ack.UNSUPPORTED
        if not math.isfinite(message.z) or abs(message.z) >= 100_000:
            return Ack.ERROR
        yaw = message.param4 if math.isfinite(message.param4) else math.nan
        frame, auto = (5, 0) if fenced else (message.frame, int(bool(message.autocontinue)))
        params = (*parameters_of(message), yaw)
        return Item(message.seq, frame, message.command, params, message.x, message.y, message.z, auto)
