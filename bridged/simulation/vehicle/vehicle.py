"""A simulated vehicle on MAVLink: messages in, messages out, and time in steps.

It does no input or output and knows no clock, so a test moves it in milliseconds: `receive` a message, `advance` the
time, read the replies.
"""

import math
import random
from collections.abc import Callable, Iterable

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport.framing import Gate
from bridged.drivers.mavlink.transport.signing import LATEST, Signing
from bridged.simulation.vehicle.autopilot import CHARGE_S, STEP_S, Autopilot, BootKind
from bridged.simulation.vehicle.fault_injection import Faults, VehicleFaults, WindFault
from bridged.simulation.vehicle.geodesy import Place
from bridged.simulation.vehicle.kinds import COPTER, VehicleKind
from bridged.simulation.vehicle.messages import Channel, Messages
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.notifications import Severity

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

    def set_up(self, message: dialect.MAVLink_message, autopilot: Autopilot) -> None:
        """SETUP_SIGNING: from now on the vehicle signs; a key of zeros ends it. Refused with motors on (ArduPilot)."""
        if autopilot.armed:
            autopilot.send_text("ERROR: Won't setup signing when armed", Severity.CRITICAL)
            return
        key = bytes(message.secret_key)
        if not any(key) and message.initial_timestamp == 0:
            self.signing = None
            return
        if message.initial_timestamp > LATEST:
            autopilot.send_text("ERROR: signing timestamp beyond 48 bits", Severity.CRITICAL)
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

    def refusal(self, packet: bytearray, system: int, message_id: int) -> str:
        unsigned = message_id in UNSIGNED_TAKEN or (self._open and not self._state.everywhere)
        return "" if unsigned or self._state.signing is None else self._state.signing.objection(packet)


COMPONENT = 1
"""Component id of the autopilot (MAV_COMP_ID_AUTOPILOT1)."""

LONGEST_STEP_S = 0.2
"""Most vehicle seconds of a step, in which the vehicle moves by shorter ones."""

REBOOT_SILENCE_S = 1.2
"""Recorded; input is ignored meanwhile."""


GUST_LASTS_S = 3.0
"""Seconds after which a gust is down to 1/e."""


class Wind:
    """The motion of the air, in steps; `air` is the velocity of the present step in m/s."""

    def __init__(self, wind: WindFault, seed: int) -> None:
        towards = math.radians(wind.bearing + 180)
        self._mean = (wind.speed * math.cos(towards), wind.speed * math.sin(towards))
        self._gust, self._dice, self._gusts = wind.gust, random.Random(f"{seed} wind"), [0.0, 0.0]
        self.air = Vector(*self._mean)

    @classmethod
    def of(cls, faults: Faults) -> "Wind | None":
        """Return the wind among the faults of a vehicle; None: the air is still."""
        return cls(faults.wind, faults.seed) if faults.wind is not None else None

    def step(self, dt: float) -> Vector:
        """Advance by `dt` seconds and return the velocity of the air in m/s."""
        if self._gust:
            lasts = math.exp(-dt / GUST_LASTS_S)
            spread = self._gust * math.sqrt(1 - lasts * lasts)
            self._gusts = [one * lasts + self._dice.gauss(0.0, spread) for one in self._gusts]
            self.air = Vector(*(mean + gust for mean, gust in zip(self._mean, self._gusts, strict=True)))
        return self.air


class Vehicle:
    """One simulated vehicle on one link or several."""

    def __init__(
        self,
        start: Place,
        kind: VehicleKind = COPTER,
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
        """`start` is where it is switched on, `heading` in radians; `boot` how long it takes until it can move.

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
        self.kind = kind
        self._faults = faults or Faults()
        self._wind = Wind.of(self._faults)
        self._channel_count = channels
        autopilot = kind.make(start, heading, boot, system, parameters, charge_time)
        self.vehicle_faults = VehicleFaults(self._faults, autopilot.PILOTED, autopilot.LANDING, autopilot.GIVEN_BACK)
        self._power_on(autopilot)

    def _power_on(self, autopilot: Autopilot) -> None:
        self.autopilot = autopilot
        autopilot.on_servo = lambda output, pulse: self.on_servo(output, pulse)
        self.handler = self.kind.messages(autopilot)
        self.channels = [Channel(self.handler.streams()) for _ in range(self._channel_count)]
        self._reboot_in: float | None = None
        self._lag = 0.0

    def receive(self, message: dialect.MAVLink_message, channel: int = 0) -> Messages:
        """Handle one message of another system; returns the immediate replies on the same channel."""
        if self._reboot_in is not None or getattr(message, "target_system", 0) not in (0, self.system):
            return []
        here = self.channels[channel]
        here.heard = True
        replies = self.vehicle_faults.false_reply(message)
        if replies is None and message.get_type() == "SETUP_SIGNING":
            self.signing_state.set_up(message, self.autopilot)
            replies = []
        here.outbox += self.handler.answer(message, here) if replies is None else replies
        if self.handler.reboots:
            self._reboot_in = REBOOT_SILENCE_S
        self._send_events()
        return self.vehicle_faults.applied_to(here.take())

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
        """Return how many steps of motion are one here: to the next message or check, or what there is time for."""
        autopilot = self.autopilot
        if self._reboot_in is not None or autopilot.booting or self.handler.waits:
            return 1
        until = min(self.seconds_until_due(), autopilot.next_guard - autopilot.now, LONGEST_STEP_S)
        return max(1, min(math.ceil(until / STEP_S - 1e-6), int((self._lag + 1e-9) / STEP_S)))

    def waiting(self, channel: int = 0) -> Messages:
        """Return the messages on a channel since the last call."""
        return self.vehicle_faults.applied_to(self.channels[channel].take())

    def seconds_until_due(self) -> float:
        """Return the vehicle time until a message is due; events in flight may come earlier."""
        if self._reboot_in is not None:
            return self._reboot_in
        if any(channel.list_at is not None for channel in self.channels):
            return STEP_S
        return max(0.0, min(channel.streams.next_due() for channel in self.channels) - self.autopilot.now)

    def _step(self, dt: float) -> None:
        autopilot = self.autopilot
        if self._reboot_in is not None:
            self._wait_for_power(dt)
            return
        if self.vehicle_faults.restarts(self.age):
            self._reboot_in = REBOOT_SILENCE_S
            autopilot.flight.disarm()
            return
        if self._faults.prearm:
            autopilot.hindrance = self.vehicle_faults.failing_check(self.age)
        if self._wind is not None or self._faults.gps:
            air = self._wind.step(dt) if self._wind is not None else Vector()
            autopilot.feel(air, self._faults.gps_error(self.age), dt)
        if self._faults.pilots:
            mode = self.vehicle_faults.switched_mode(self.age, autopilot.mode, airborne=autopilot.flight.airborne)
            if mode is not None:
                autopilot.pilot_sets(mode)
        autopilot.step(dt)
        self.on_step()
        self._send_events()
        for message in self.handler.continued():
            for channel in self.channels:
                channel.outbox.append(message)
        self._send_events()
        regular = self.handler.regular()
        for channel in self.channels:
            channel.outbox += self.handler.streamed(channel, autopilot.now)
            channel.outbox += regular
            channel.outbox += self.handler.listed(channel)

    def _wait_for_power(self, dt: float) -> None:
        """Restart the autopilot where the vehicle is, which falls in the air meanwhile; what it has stored is kept."""
        assert self._reboot_in is not None
        autopilot = self.autopilot
        if autopilot.flight.airborne:
            autopilot.flight.step(dt)
        self._reboot_in -= dt
        if self._reboot_in > 0:
            return
        self.reboots += 1
        at, up = autopilot.truth, autopilot.motion.up
        lag = self._lag
        self._power_on(autopilot.restarted(autopilot.chart.place(Vector(at.north, at.east, 0.0))))
        self._lag = lag
        if autopilot.flight.airborne:
            self.autopilot.flight.fall_from(up)

    def _send_events(self) -> None:
        events, self.autopilot.events = self.autopilot.events, []
        for event in events:
            self.handler.notify(event, self.channels)
