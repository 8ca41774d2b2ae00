"""The simulated copter on MAVLink: messages in, messages out, and time in steps.

It does no input or output and knows no clock, so a test flies it in milliseconds: `receive` a message, `advance` the
time, read the replies.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport.framing import Gate
from bridged.drivers.mavlink.transport.signing import LATEST, Signing
from bridged.simulation.vehicle.ardupilot import telemetry
from bridged.simulation.vehicle.ardupilot.battery import CHARGE_S
from bridged.simulation.vehicle.ardupilot.boot import BootKind, Milestone
from bridged.simulation.vehicle.ardupilot.commands import Command, CommandContext, global_setpoint, local_setpoint
from bridged.simulation.vehicle.ardupilot.copter import STEP_S, Copter
from bridged.simulation.vehicle.ardupilot.mission import Mission
from bridged.simulation.vehicle.ardupilot.mission_protocol import MissionProtocol
from bridged.simulation.vehicle.ardupilot.notifications import (
    Event,
    HomeChanged,
    ItemReached,
    ModeChanged,
    ParameterChanged,
    Severity,
    Text,
)
from bridged.simulation.vehicle.ardupilot.parameters import Parameter, Parameters
from bridged.simulation.vehicle.ardupilot.telemetry import Streams
from bridged.simulation.vehicle.fault_injection import Character, Faults
from bridged.simulation.vehicle.geodesy import Place
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.wind import Wind

UNSIGNED_TAKEN = frozenset((dialect.MAVLINK_MSG_ID_RADIO_STATUS, dialect.MAVLINK_MSG_ID_RADIO))
"""Messages of telemetry radios, which have no key (ArduPilot accepts them unsigned everywhere)."""

OPEN_CHANNEL = 0
"""The first link of an autopilot, its USB plug: whoever has hands on it needs no signature (ArduPilot), unless the
vehicle was started with a key."""


class SigningState:
    """Signing key of one vehicle, if it has one. It survives a reboot."""

    def __init__(self, key: bytes | None = None) -> None:
        self.everywhere = key is not None
        """Whether signatures are required on the first link too."""
        self.signing = Signing(key) if key is not None else None

    def set_up(self, message: dialect.MAVLink_message, copter: Copter) -> None:
        """SETUP_SIGNING: from now on the vehicle signs; a key of zeros ends it. Refused with motors on (ArduPilot)."""
        if copter.armed:
            copter.send_text("ERROR: Won't setup signing when armed", Severity.CRITICAL)
            return
        key = bytes(message.secret_key)
        if not any(key) and message.initial_timestamp == 0:
            self.signing = None
            return
        if message.initial_timestamp > LATEST:
            copter.send_text("ERROR: signing timestamp beyond 48 bits", Severity.CRITICAL)
            return
        self.signing = Signing(key)
        self.signing.timestamps.heard(message.initial_timestamp)

    def gate(self, channel: int) -> Gate:
        """Return the gate for incoming packets of a link, by its number from 0."""
        return _SigningGate(self, channel)


class _SigningGate(Gate):
    def __init__(self, state: SigningState, channel: int) -> None:
        self._state = state
        self._open = channel == OPEN_CHANNEL
        self._message = 0

    def wants(self, system: int, message_id: int) -> bool:
        self._message = message_id  # of the packet about which `signing` is asked next
        return True

    def signing(self, system: int) -> Signing | None:
        if self._message in UNSIGNED_TAKEN or (self._open and not self._state.everywhere):
            return None
        return self._state.signing


COMPONENT = 1
"""Component id of the autopilot (MAV_COMP_ID_AUTOPILOT1)."""

LONGEST_STEP_S = 0.2
"""Most vehicle seconds of a step, in which the copter moves by shorter ones."""

REBOOT_SILENCE_S = 1.2
"""Recorded; input is ignored meanwhile."""

TIMESYNC_PERIOD_S = 10.0

PARAMETERS_PER_STEP = 5
"""Parameters of a requested list sent per step."""

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


@dataclass(slots=True)
class Channel:
    """One link of the vehicle: its requested streams and its outbox."""

    streams: Streams = field(default_factory=Streams)
    heard: bool = False
    list_at: int | None = None  # the parameter that comes next in a list that was asked for
    outbox: Messages = field(default_factory=list)

    def take(self) -> Messages:
        """Return and clear the outbox."""
        waiting, self.outbox = self.outbox, []
        return waiting


class Vehicle:
    """One simulated ArduCopter on one link or several."""

    def __init__(
        self,
        start: Place,
        *,
        system: int = 1,
        heading: float = 0.0,
        boot: BootKind = "quick",
        channels: int = 1,
        faults: Faults | None = None,
        key: bytes | None = None,
        parameters: Iterable[tuple[str, float]] = (),
        charge_time: float = CHARGE_S,
    ) -> None:
        """`start` is where it is switched on, `heading` in radians; `boot` how long it takes until it can fly.

        With a `key` it signs what it sends and takes only what is signed. `parameters` are set before it is switched
        on; raises ValueError for a name that it does not have. At home an empty battery is full after `charge_time`
        vehicle seconds.
        """
        if not 1 <= system <= 255:
            raise ValueError(f"a system id lies between 1 and 255, got {system}")
        self.system = system
        self.signing_state = SigningState(key)
        self.age = 0.0
        """Vehicle seconds since it was switched on the first time."""
        self.reboots = 0
        self.on_servo: Callable[[int, int], None] = lambda output, pulse: None
        """Called with each output and its new pulse in microseconds."""
        self.on_step: Callable[[], None] = lambda: None
        """Called after each step."""
        self._boot: BootKind = boot
        self._faults = faults or Faults()
        self.character, self._wind = Character(self._faults), Wind.of(self._faults)
        self._channel_count = channels
        self._charge_time = charge_time
        stored = Parameters(system)
        for name, value in parameters:
            if stored.set(name, value) is None:
                raise ValueError(f"the simulated copter has no parameter {name!r}")
        self._power_on(start, heading, stored, Mission())

    def _power_on(self, place: Place, heading: float, parameters: Parameters, mission: Mission) -> None:
        self.autopilot = Copter(
            place,
            heading=heading,
            boot=self._boot,
            parameters=parameters,
            stored=mission,
            charge_time=self._charge_time,
        )
        self.autopilot.outputs.on_move = lambda output, pulse: self.on_servo(output, pulse)
        self.channels = [Channel() for _ in range(self._channel_count)]
        self._mission = MissionProtocol(self.autopilot)
        self._next_timesync = TIMESYNC_PERIOD_S
        self._reboot_in: float | None = None
        self._lag = 0.0

    def receive(self, message: dialect.MAVLink_message, channel: int = 0) -> Messages:
        """Handle one message of another system; returns the immediate replies on the same channel."""
        if self._reboot_in is not None or getattr(message, "target_system", 0) not in (0, self.system):
            return []
        here = self.channels[channel]
        here.heard = True
        replies = self.character.pretends(message)
        here.outbox += self._answer(message, here) if replies is None else replies
        self._send_events()
        return self.character.says(here.take())

    def advance(self, seconds: float) -> Messages:
        """Advance vehicle time by `seconds`; returns the messages sent meanwhile on the first channel."""
        self._lag += seconds
        while self._lag >= STEP_S - 1e-9:
            step = STEP_S * self._steps_to_event()
            self._lag -= step
            self.age += step
            self._step(step)
        return self.waiting()

    def _steps_to_event(self) -> int:
        """Return how many steps of the copter are one here: to the next message or check, or what there is time for."""
        copter = self.autopilot
        if self._reboot_in is not None or not copter.boot.complete:
            return 1
        until = min(self.seconds_until_due(), copter.next_guard - copter.now, LONGEST_STEP_S)
        return max(1, min(math.ceil(until / STEP_S - 1e-6), int((self._lag + 1e-9) / STEP_S)))

    def waiting(self, channel: int = 0) -> Messages:
        """Return the messages on a channel since the last call."""
        return self.character.says(self.channels[channel].take())

    def seconds_until_due(self) -> float:
        """Return the vehicle time until a message is due; events in flight may come earlier."""
        if self._reboot_in is not None:
            return self._reboot_in
        if any(channel.list_at is not None for channel in self.channels):
            return STEP_S
        return max(0.0, min(channel.streams.next_due() for channel in self.channels) - self.autopilot.now)

    def _step(self, dt: float) -> None:
        copter = self.autopilot
        if self._reboot_in is not None:
            self._wait_for_power(dt)
            return
        if self.character.restarts(self.age):
            self._reboot_in = REBOOT_SILENCE_S
            copter.flight.disarm()
            return
        if self._faults.prearm:
            copter.hindrance = self.character.hinders(self.age)
        if self._wind is not None or self._faults.gps:
            air = self._wind.step(dt) if self._wind is not None else Vector()
            copter.feel(air, self._faults.gps_error(self.age), dt)
        if self._faults.pilots:
            mode = self.character.switched_mode(self.age, copter.mode, airborne=copter.flight.airborne)
            if mode is not None:
                copter.set_mode(mode)
        copter.step(dt)
        self.on_step()
        self._send_events()
        for message in self._mission.advance():
            for channel in self.channels:
                channel.outbox.append(message)
        self._send_events()
        timesync = copter.now >= self._next_timesync
        if timesync:
            self._next_timesync += TIMESYNC_PERIOD_S
        for channel in self.channels:
            self._stream(channel)
            if timesync:
                channel.outbox.append(dialect.MAVLink_timesync_message(0, self._nanoseconds()))
            if channel.list_at is not None:
                self._list(channel)

    def _wait_for_power(self, dt: float) -> None:
        """Restart the autopilot; a copter in the air falls meanwhile."""
        assert self._reboot_in is not None
        copter = self.autopilot
        if copter.flight.airborne:
            copter.flight.step(dt)
        self._reboot_in -= dt
        if self._reboot_in > 0:
            return
        copter.mission.rewind()
        self.reboots += 1
        at, up = copter.truth, copter.motion.up
        lag = self._lag
        ground = copter.chart.place(Vector(at.north, at.east, 0.0))
        self._power_on(ground, copter.motion.heading, copter.parameters, copter.mission)
        self._lag = lag
        if copter.flight.airborne:
            self.autopilot.fall_from(up)

    def _stream(self, channel: Channel) -> None:
        for message in channel.streams.due(self.autopilot.now):
            if message != HEARTBEAT and not self.autopilot.passed(Milestone.READY):
                continue
            built = telemetry.BUILDERS[message](self.autopilot)
            if built is not None:
                channel.outbox.append(built)

    def _nanoseconds(self) -> int:
        return round(self.autopilot.now * 1e9)

    def _list(self, channel: Channel) -> None:
        for _ in range(PARAMETERS_PER_STEP):
            parameter = self.autopilot.parameters.at(channel.list_at or 0)
            if parameter is None:
                channel.list_at = None
                return
            channel.outbox.append(self._value_of(parameter, parameter.index))
            channel.list_at = parameter.index + 1

    def _value_of(self, parameter: Parameter, index: int = _NO_INDEX) -> dialect.MAVLink_message:
        return dialect.MAVLink_param_value_message(
            parameter.name.encode(), parameter.value, parameter.kind, len(self.autopilot.parameters), index
        )

    def _send_events(self) -> None:
        """Send events on every channel; STATUSTEXT only where a peer was heard (recorded)."""
        if not self.autopilot.events:
            return
        events, self.autopilot.events = self.autopilot.events, []
        for event in events:
            messages = self._messages_of(event)
            for channel in self.channels:
                if channel.heard or not isinstance(event, Text):
                    channel.outbox += messages

    def _messages_of(self, event: Event) -> Messages:
        match event:
            case Text(severity, text):
                return [dialect.MAVLink_statustext_message(severity, text.encode()[:50])]
            case ModeChanged():
                return [telemetry.heartbeat(self.autopilot)]
            case HomeChanged():
                both = (telemetry.gps_global_origin(self.autopilot), telemetry.home_position(self.autopilot))
                return [message for message in both if message is not None]
            case ParameterChanged(name):
                parameter = self.autopilot.parameters.find(name)
                return [self._value_of(parameter)] if parameter is not None else []
            case ItemReached(seq):
                return [dialect.MAVLink_mission_item_reached_message(seq)]

    def _answer(self, message: dialect.MAVLink_message, channel: Channel) -> Messages:
        kind = message.get_type()
        match kind:
            case "HEARTBEAT":
                self.autopilot.station.heartbeat(message.get_srcSystem(), self.autopilot.now)
            case "COMMAND_LONG":
                return self._command(message, Command.of_long(message), channel)
            case "COMMAND_INT":
                return self._command(message, Command.of_int(message), channel)
            case "SET_MODE":
                if message.base_mode & 1:  # never acknowledged (recorded)
                    self.autopilot.set_mode(message.custom_mode)
            case "SET_POSITION_TARGET_GLOBAL_INT":
                global_setpoint(self.autopilot, message)
            case "SET_POSITION_TARGET_LOCAL_NED":
                local_setpoint(self.autopilot, message)
            case "RC_CHANNELS_OVERRIDE":
                self.autopilot.transmitter.override(message, self.autopilot.now)
            case "REQUEST_DATA_STREAM":
                channel.streams.request(
                    message.req_stream_id, message.req_message_rate, self.autopilot.now, on=bool(message.start_stop)
                )
            case "TIMESYNC" if message.tc1 == 0:
                return [dialect.MAVLink_timesync_message(self._nanoseconds(), message.ts1)]
            case "PARAM_REQUEST_READ" | "PARAM_REQUEST_LIST" | "PARAM_SET":
                return self._parameter(message, kind, channel)
            case "SETUP_SIGNING":
                self.signing_state.set_up(message, self.autopilot)
            case _ if kind in _MISSION_MESSAGES:
                return self._mission.receive(message)
        return []

    def _command(self, message: dialect.MAVLink_message, command: Command, channel: Channel) -> Messages:
        context = CommandContext(self.autopilot, channel.streams)
        result = context.carry_out(command)
        sender = (message.get_srcSystem(), message.get_srcComponent())
        ack = dialect.MAVLink_command_ack_message(command.number, int(result), 0, 0, *sender)
        if context.reboot_wanted:
            self._reboot_in = REBOOT_SILENCE_S
        return [*context.ahead, ack, *context.after]

    def _parameter(self, message: dialect.MAVLink_message, kind: str, channel: Channel) -> Messages:
        parameters = self.autopilot.parameters
        if kind == "PARAM_REQUEST_LIST":
            channel.list_at = 0
            return []
        if kind == "PARAM_REQUEST_READ" and message.param_index >= 0:
            found, index = parameters.at(message.param_index), message.param_index
        else:
            name = message.param_id
            name = name.decode(errors="replace") if isinstance(name, bytes) else str(name)
            value = message.param_value if kind == "PARAM_SET" else math.nan
            found, index = parameters.set(name, value) if name else None, _NO_INDEX
        return [self._value_of(found, index)] if found is not None else []
