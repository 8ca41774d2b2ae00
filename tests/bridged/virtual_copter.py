"""A simulated vehicle in virtual time, and a ground station that talks to it in real MAVLink bytes."""

import math
from collections.abc import Callable, Sequence

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport.framing import Encoder, Framer, WireCounters
from bridged.simulation.vehicle.ardupilot.flight_modes import Mode
from bridged.simulation.vehicle.autopilot import BootKind
from bridged.simulation.vehicle.fault_injection import Faults
from bridged.simulation.vehicle.kinds import COPTER, VehicleKind
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.vehicle import Vehicle
from tests.bridged.sky import HOME

STEP = 0.1


class Station:
    """Says things to one vehicle and keeps what it hears. `now` is vehicle time."""

    def __init__(
        self,
        boot: BootKind = "quick",
        system: int = 1,
        ready: bool = True,
        kind: VehicleKind = COPTER,
        faults: Sequence[str] = (),
    ) -> None:
        self.vehicle = Vehicle(HOME, kind, system=system, boot=boot, faults=Faults.parse(faults))
        self.autopilot = self.vehicle.autopilot
        self.heard: list[dialect.MAVLink_message] = []
        self._encoder, self._framer = Encoder(255, 190), Framer(WireCounters())
        self._vehicle_encoder, self._ear = Encoder(system, 1), Framer(WireCounters())
        if ready:
            self.heartbeat()
            self.wait(4.0)
            self.heard.clear()

    @property
    def now(self) -> float:
        return self.vehicle.autopilot.now

    @property
    def at(self) -> Vector:
        return self.vehicle.autopilot.motion.position

    def say(self, message: dialect.MAVLink_message) -> list[dialect.MAVLink_message]:
        """Sends a message over the wire; returns what comes back at once."""
        (heard,) = self._framer.feed(self._encoder.pack(message), datagram=True)
        return self._hear(self.vehicle.receive(heard))

    def _hear(self, messages: list[dialect.MAVLink_message]) -> list[dialect.MAVLink_message]:
        # What the vehicle sends must be packable: the bytes are what counts.
        packets = b"".join(self._vehicle_encoder.pack(message) for message in messages)
        read = self._ear.feed(packets, datagram=True)
        assert len(read) == len(messages)
        self.heard += read
        return read

    def heartbeat(self) -> None:
        self.say(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))

    def command(self, number: int, *params: float, target: int = 1) -> int:
        """Sends a COMMAND_LONG; returns the result of its acknowledgement."""
        padded = (*params, *([0.0] * (7 - len(params))))
        replies = self.say(dialect.MAVLink_command_long_message(target, 1, number, 0, *padded))
        (ack,) = [reply for reply in replies if reply.get_type() == "COMMAND_ACK"]
        assert ack.command == number
        result: int = ack.result
        return result

    def setpoint(self, goal: Vector, frame: int = 6, mask: int = 3576, yaw: float = 0.0) -> None:
        """A goal in metres north, east and above home."""
        place = self.autopilot.chart.place(goal)
        alt = goal.up if frame == 6 else place.alt
        self.say(
            dialect.MAVLink_set_position_target_global_int_message(
                0, 1, 1, frame, mask, place.lat_e7, place.lon_e7, alt, 0, 0, 0, 0, 0, 0, yaw, 0
            )
        )

    def wait(self, seconds: float) -> list[dialect.MAVLink_message]:
        """Lets time pass; returns what was heard meanwhile."""
        return self._hear(self.vehicle.advance(seconds))

    def until(self, wish: Callable[[], bool], what: str, seconds: float = 120.0, step: float = STEP) -> float:
        """Lets time pass until the wish is true; returns how long it took."""
        begin = self.now
        while not wish():
            assert self.now - begin < seconds, f"no {what} in {seconds:g} s of virtual time"
            self.wait(step)
        return self.now - begin

    def texts(self) -> list[str]:
        return [message.text for message in self.heard if message.get_type() == "STATUSTEXT"]

    def kinds(self) -> set[str]:
        return {message.get_type() for message in self.heard}

    def distance(self, goal: Vector) -> float:
        return math.hypot(goal.north - self.at.north, goal.east - self.at.east)

    @property
    def speed(self) -> float:
        velocity = self.vehicle.autopilot.motion.velocity
        return math.hypot(velocity.north, velocity.east, velocity.up)

    def guided(self) -> None:
        assert self.command(176, 1, Mode.GUIDED) == 0

    def fly_to(self, height: float, *, pause: float = 2.75) -> float:
        """GUIDED, arm, takeoff; returns the seconds from the takeoff command to 10 cm below the height."""
        self.guided()
        assert self.command(400, 1) == 0
        self.wait(pause)
        assert self.command(22, 0, 0, 0, 0, 0, 0, height) == 0
        home = self.vehicle.autopilot.home_on_chart.up
        took = self.until(lambda: self.at.up - home > height - 0.1, f"takeoff to {height} m")
        self.until(lambda: self.vehicle.autopilot.flight.landed == 2 and self.speed < 0.05, "hover")
        return took
