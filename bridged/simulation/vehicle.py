"""The simulated copter as others see it: MAVLink messages in, MAVLink messages out, and time that passes by steps.

It does no input or output and knows no clock, so a test flies it in milliseconds: `receive` a message, `advance` the
time, look at what comes back.
"""

import math

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation import setpoints, telemetry
from bridged.simulation.boot import BootKind, Milestone
from bridged.simulation.commands import Command, Desk
from bridged.simulation.copter import Copter
from bridged.simulation.events import Event, HomeChanged, ItemReached, ModeChanged, ParameterChanged, Text
from bridged.simulation.geo import Place
from bridged.simulation.mission import Mission
from bridged.simulation.mission_protocol import MissionProtocol
from bridged.simulation.parameters import Parameter, Parameters
from bridged.simulation.streams import Streams

COMPONENT = 1
"""Component id of the autopilot (MAV_COMP_ID_AUTOPILOT1)."""

STEP_S = 0.02
"""Vehicle seconds per step of the simulation."""

REBOOT_SILENCE_S = 1.2
"""Recorded; what comes in meanwhile is not heard."""

TIMESYNC_PERIOD_S = 10.0

PARAMETERS_PER_STEP = 5
"""How many parameters of a requested list go out per step."""

HEARTBEAT = 0

_NO_INDEX = 65535
_MISSION_MESSAGES = frozenset(
    (
        "MISSION_REQUEST_LIST",
        "MISSION_REQUEST",
        "MISSION_REQUEST_INT",
        "MISSION_COUNT",
        "MISSION_ITEM",
        "MISSION_ITEM_INT",
        "MISSION_CLEAR_ALL",
        "MISSION_SET_CURRENT",
    )
)

Messages = list[dialect.MAVLink_message]


class Vehicle:
    """One simulated ArduCopter on one link."""

    def __init__(
        self,
        start: Place,
        *,
        system: int = 1,
        heading: float = 0.0,
        boot: BootKind = "quick",
    ) -> None:
        """`start` is where it is switched on, `heading` in radians; `boot` how long it takes until it can fly."""
        if not 1 <= system <= 255:
            raise ValueError(f"a system id lies between 1 and 255, got {system}")
        self.system = system
        self.reboots = 0
        self._boot: BootKind = boot
        self._power_on(start, heading, Parameters(system), Mission())

    def _power_on(self, place: Place, heading: float, parameters: Parameters, mission: Mission) -> None:
        self.copter = Copter(place, heading=heading, boot=self._boot, parameters=parameters, mission=mission)
        self._streams = Streams()
        self._mission = MissionProtocol(self.copter)
        self._heard = False
        self._list_at: int | None = None
        self._next_timesync = TIMESYNC_PERIOD_S
        self._reboot_in: float | None = None
        self._lag = 0.0

    def receive(self, message: dialect.MAVLink_message) -> Messages:
        """Takes in one message of another system; returns what the vehicle answers at once."""
        if self._reboot_in is not None or not self._is_for_us(message):
            return []
        self._heard = True
        replies = self._answer(message)
        return replies + self._told()

    def advance(self, seconds: float) -> Messages:
        """Lets vehicle time pass; returns what the vehicle sends meanwhile."""
        outgoing: Messages = []
        self._lag += seconds
        while self._lag >= STEP_S - 1e-9:
            self._lag -= STEP_S
            outgoing += self._step()
        return outgoing

    def seconds_until_due(self) -> float:
        """How much vehicle time may pass before there is something to send for sure; motion may bring more."""
        if self._reboot_in is not None:
            return self._reboot_in
        if self._list_at is not None:
            return STEP_S
        return max(0.0, self._streams.next_due() - self.copter.now)

    def _is_for_us(self, message: dialect.MAVLink_message) -> bool:
        target = getattr(message, "target_system", 0)
        return target in (0, self.system)

    def _step(self) -> Messages:
        if self._reboot_in is not None:
            self._reboot_in -= STEP_S
            if self._reboot_in <= 0:
                copter = self.copter
                copter.mission.rewind()
                self.reboots += 1
                self._power_on(copter.place, copter.motion.heading, copter.parameters, copter.mission)
            return []
        self.copter.step(STEP_S)
        outgoing = self._told()
        outgoing += self._mission.advance()
        outgoing += self._told()
        for message in self._streams.due(self.copter.now):
            if message != HEARTBEAT and not self.copter.passed(Milestone.READY):
                continue
            built = telemetry.BUILDERS[message](self.copter)
            if built is not None:
                outgoing.append(built)
        if self.copter.now >= self._next_timesync:
            self._next_timesync += TIMESYNC_PERIOD_S
            outgoing.append(dialect.MAVLink_timesync_message(0, self._nanoseconds()))
        outgoing += self._listed()
        return outgoing

    def _nanoseconds(self) -> int:
        return round(self.copter.now * 1e9)

    def _listed(self) -> Messages:
        outgoing: Messages = []
        while self._list_at is not None and len(outgoing) < PARAMETERS_PER_STEP:
            parameter = self.copter.parameters.at(self._list_at)
            if parameter is None:
                self._list_at = None
                break
            outgoing.append(self._value_of(parameter, parameter.index))
            self._list_at += 1
        return outgoing

    def _value_of(self, parameter: Parameter, index: int = _NO_INDEX) -> dialect.MAVLink_message:
        return dialect.MAVLink_param_value_message(
            parameter.name.encode(), parameter.value, parameter.kind, len(self.copter.parameters), index
        )

    def _told(self) -> Messages:
        events, self.copter.events = self.copter.events, []
        return [message for event in events for message in self._messages_of(event)]

    def _messages_of(self, event: Event) -> Messages:
        match event:
            case Text(severity, text):
                # A vehicle talks to people only on links on which somebody listens (recorded).
                return [dialect.MAVLink_statustext_message(severity, text.encode()[:50])] if self._heard else []
            case ModeChanged():
                return [telemetry.heartbeat(self.copter)]
            case HomeChanged():
                both = (telemetry.gps_global_origin(self.copter), telemetry.home_position(self.copter))
                return [message for message in both if message is not None]
            case ParameterChanged(name):
                parameter = self.copter.parameters.find(name)
                return [self._value_of(parameter)] if parameter is not None else []
            case ItemReached(seq):
                return [dialect.MAVLink_mission_item_reached_message(seq)]

    def _answer(self, message: dialect.MAVLink_message) -> Messages:
        kind = message.get_type()
        match kind:
            case "HEARTBEAT":
                self.copter.station.heartbeat(message.get_srcSystem(), self.copter.now)
            case "COMMAND_LONG":
                return self._command(message, Command.of_long(message))
            case "COMMAND_INT":
                return self._command(message, Command.of_int(message))
            case "SET_MODE":
                if message.base_mode & 1:  # never acknowledged (recorded)
                    self.copter.set_mode(message.custom_mode)
            case "SET_POSITION_TARGET_GLOBAL_INT":
                setpoints.global_setpoint(self.copter, message)
            case "SET_POSITION_TARGET_LOCAL_NED":
                setpoints.local_setpoint(self.copter, message)
            case "REQUEST_DATA_STREAM":
                self._streams.request(
                    message.req_stream_id, message.req_message_rate, self.copter.now, on=bool(message.start_stop)
                )
            case "TIMESYNC" if message.tc1 == 0:
                return [dialect.MAVLink_timesync_message(self._nanoseconds(), message.ts1)]
            case "PARAM_REQUEST_READ" | "PARAM_REQUEST_LIST" | "PARAM_SET":
                return self._parameter(message, kind)
            case _ if kind in _MISSION_MESSAGES:
                return self._mission.receive(message)
        return []

    def _command(self, message: dialect.MAVLink_message, command: Command) -> Messages:
        desk = Desk(self.copter, self._streams)
        result = desk.carry_out(command)
        sender = (message.get_srcSystem(), message.get_srcComponent())
        ack = dialect.MAVLink_command_ack_message(command.number, int(result), 0, 0, *sender)
        if desk.reboot_wanted:
            self._reboot_in = REBOOT_SILENCE_S
        return [*desk.ahead, ack, *desk.after]

    def _parameter(self, message: dialect.MAVLink_message, kind: str) -> Messages:
        parameters = self.copter.parameters
        if kind == "PARAM_REQUEST_LIST":
            self._list_at = 0
            return []
        if kind == "PARAM_REQUEST_READ" and message.param_index >= 0:
            found, index = parameters.at(message.param_index), message.param_index
        else:
            name = _name_of(message)
            value = message.param_value if kind == "PARAM_SET" else math.nan
            found, index = parameters.set(name, value) if name else None, _NO_INDEX
        return [self._value_of(found, index)] if found is not None else []


def _name_of(message: dialect.MAVLink_message) -> str:
    name = message.param_id
    return name.decode(errors="replace") if isinstance(name, bytes) else str(name)
