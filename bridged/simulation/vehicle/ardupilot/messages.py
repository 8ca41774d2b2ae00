"""The MAVLink side of a simulated ArduPilot."""

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.ardupilot import telemetry
from bridged.simulation.vehicle.ardupilot.ardupilot import ArduPilot
from bridged.simulation.vehicle.ardupilot.boot import Milestone
from bridged.simulation.vehicle.ardupilot.commands import CommandContext, global_setpoint, local_setpoint
from bridged.simulation.vehicle.ardupilot.mission_protocol import ArduPilotMissions
from bridged.simulation.vehicle.command_messages import Command
from bridged.simulation.vehicle.log_transfer import LOG_MESSAGES, LogTransfer, dataflash_log
from bridged.simulation.vehicle.messages import Channel, MessageHandler, Messages, Streams, parameter_name
from bridged.simulation.vehicle.notifications import (
    Event,
    HomeChanged,
    ModeChanged,
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
