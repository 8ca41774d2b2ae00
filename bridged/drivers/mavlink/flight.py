"""What a procedure works with: the vehicle's state, the means to act on it, and the patience to wait for it."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.commands import Command, Commands, Parameters
from bridged.drivers.mavlink.texts import Texts
from bridged.drivers.mavlink.vehicle import Place, Vehicle
from bridged.drivers.robot import Execution, Outcome
from schemas.manifest import Retry
from schemas.mission import Limits

Steps = Generator[None, None, Outcome]
"""A procedure: it looks at the flight, yields until something changes, and returns how it ended."""

TEXT_WINDOW = (1.0, 0.3)
"""Mission and wall seconds around an acknowledgement in which the vehicle's texts belong to it."""
EXPECTED_FOR = (5.0, 2.0)
"""Mission and wall seconds for which a mode that we asked for may still appear."""
POSITION_ONLY = 0b110111111000
"""Type mask of a position target: velocity, acceleration, yaw and yaw rate ignored."""

SUCCEEDED = Outcome("succeeded")


@dataclass(eq=False)
class Task(Execution):
    """An execution that runs as a procedure."""

    moves: bool = True
    """A mode that nobody here asked for ends it."""
    sets_mode: bool = False
    """Changes of the mode are its own business."""
    takes_control: bool = False
    """Its success ends an override by others."""
    yields: bool = False
    """It is nobody's wish but the bridge's own: a mode that others set ends it."""
    commands: list[Command] = field(default_factory=list)
    """What it has sent: taken back when it ends early."""


@dataclass(frozen=True, slots=True)
class Call:
    """An action of the manifest with its arguments filled in."""

    number: int = 0
    parameters: Parameters = (0.0,) * 7
    retry: Retry = field(default_factory=Retry)
    target: Place | None = None
    frame: int = dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
    tolerance: float | None = None


class Flight:
    """One vehicle, as the procedures see it. `now` is in mission seconds and moves with each message and tick."""

    def __init__(
        self,
        vehicle: Vehicle,
        commands: Commands,
        texts: Texts,
        send: Callable[[dialect.MAVLink_message], None],
        speed: float,
        limits: Limits,
    ) -> None:
        self.vehicle = vehicle
        self.commands = commands
        self.texts = texts
        self.limits = limits
        self.now = 0.0
        self.asked_last = -1
        """The mode that we asked for last: one that it takes on while it cannot be heard is nobody else's."""
        self._send = send
        self._speed = speed
        self._expected: dict[int, float] = {}

    def wait(self, mission: float, wall: float) -> float:
        """Mission seconds that last at least `mission` on the vehicle's clock and `wall` on ours (design section 8)."""
        return max(mission, wall * self._speed)

    def to_wall(self, mission: float) -> float:
        """Wall seconds that a span of mission seconds lasts: silence is told in the seconds that limits are set in."""
        return mission / self._speed

    def submit(
        self,
        task: Task,
        number: int,
        parameters: Parameters,
        retry: Retry,
        may_repeat: Callable[[], bool] = lambda: True,
    ) -> Command:
        """Send a command for a task."""
        command = Command(number, parameters, retry, may_repeat)
        task.commands.append(command)
        return self.commands.submit(command, self.now)

    def send_target(self, place: Place, frame: int) -> None:
        """Send a position target; nothing acknowledges it."""
        identity = self.commands.identity
        latitude, longitude = round(place.latitude * 1e7), round(place.longitude * 1e7)
        self._send(
            dialect.MAVLink_set_position_target_global_int_message(
                0,
                identity.vehicle,
                identity.autopilot,
                frame,
                POSITION_ONLY,
                latitude,
                longitude,
                place.altitude,
                *(0.0,) * 8,
            )
        )

    def expect_mode(self, mode: int) -> None:
        """Count `mode` as asked for by us for a while: a pilot's change must be told from our own."""
        self.asked_last = mode
        self._expected[mode] = self.now + self.wait(*EXPECTED_FOR)

    def expects(self, mode: int) -> bool:
        """Whether we asked for `mode` lately."""
        return self._expected.get(mode, -1.0) >= self.now

    def altitude_of_home(self) -> float | None:
        """Metres AMSL of home, None if nothing tells it."""
        vehicle = self.vehicle
        if vehicle.position is not None:
            return vehicle.amsl - vehicle.position.altitude
        return vehicle.home.altitude if vehicle.home is not None else None

    def outside_limits(self, place: Place) -> str:
        """Which limit of the mission a point (metres above home) breaks, in words; empty = none."""
        limits, home = self.limits, self.vehicle.home
        if limits.altitude is not None and place.altitude > limits.altitude:
            return f"altitude {place.altitude:g} m is above the mission's limit of {limits.altitude:g} m"
        if limits.radius is not None:
            if home is None:
                return "home is not known, so the mission's radius limit cannot be kept"
            distance = home.distance(place)
            if distance > limits.radius:
                return f"{distance:.0f} m from home is outside the mission's limit of {limits.radius:g} m"
        return ""

    def with_texts(self, said: str, since: float) -> str:
        """A reason with what the vehicle itself said since then, or with its state if it said nothing."""
        texts = self.texts.since(since - self.wait(*TEXT_WINDOW))
        return f"{said}: {texts}" if texts else f"{said}; {self.state_in_words()}"

    def state_in_words(self) -> str:
        """Mode, arming and where it is."""
        vehicle = self.vehicle
        if not vehicle.connected:
            return "the vehicle is not connected"
        armed = "armed" if vehicle.armed else "not armed"
        where = "in flight" if vehicle.aloft else "on the ground"
        return f"the vehicle is {armed}, {where}, in {vehicle.mode_name}"
