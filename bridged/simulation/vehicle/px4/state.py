"""The state of a simulated PX4: what it is made of, its start, and the checks before arming."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.autopilot import Autopilot, BootKind
from bridged.simulation.vehicle.geodesy import FlatMap
from bridged.simulation.vehicle.mission_items import Item
from bridged.simulation.vehicle.motion.dynamics import Motion, Vector
from bridged.simulation.vehicle.motion.tasks import Drift, Task
from bridged.simulation.vehicle.notifications import Number, Severity, Text
from bridged.simulation.vehicle.parameters import Parameters
from bridged.simulation.vehicle.px4.battery import Battery
from bridged.simulation.vehicle.px4.missions import Missions
from bridged.simulation.vehicle.px4.modes import Mode
from bridged.simulation.vehicle.px4.parameters import OUTPUTS
from bridged.simulation.vehicle.px4.texts import CRITICAL, INFO, event_of
from schemas.geo import is_inside

_HOME_S: Mapping[BootKind, float] = {"real": 0.9, "quick": 0.4}
_QUICK_READY_S = 1.0
_COMPLAINT_S = 1.0
"""When the first arming check that fails is reported (recorded: 0.1 to 1.2)."""

HEARTBEAT_TIMEOUT_S = 2.25
"""Seconds after the last HEARTBEAT of a kind at which its sender counts as silent (recorded: 2.1 to 2.6)."""
COMPANION_S = 4.8
"""Seconds of that after which the companion is lost."""


@dataclass(slots=True)
class Links:
    """HEARTBEATs of ground stations and of a companion, on any link; times in vehicle seconds."""

    station_at: float | None = None
    companion_at: float | None = None
    station_lost: bool = False
    companion_lost: bool = False

    def heard(self, message: dialect.MAVLink_message, system: int, now: float) -> None:
        """Take note of a HEARTBEAT; `system` is the vehicle's own id."""
        if message.type == dialect.MAV_TYPE_GCS:
            self.station_at = now
        elif message.type == dialect.MAV_TYPE_ONBOARD_CONTROLLER and message.get_srcSystem() == system:
            self.companion_at = now

    def station_present(self, now: float) -> bool:
        """Return whether a ground station is heard."""
        return self.station_at is not None and now - self.station_at <= HEARTBEAT_TIMEOUT_S

    def station_silent(self, now: float, limit: float) -> bool:
        """Return whether a ground station that was heard has been silent for longer than `limit` seconds."""
        return self.station_at is not None and now - self.station_at > HEARTBEAT_TIMEOUT_S + limit

    def companion_silent(self, now: float) -> bool:
        """Return whether a companion that was heard has been silent for too long."""
        return self.companion_at is not None and now - self.companion_at > HEARTBEAT_TIMEOUT_S + COMPANION_S


STICKS_LOST_S = 0.5
"""Seconds without MANUAL_CONTROL after which the sticks are lost (COM_RC_LOSS_T)."""
_MOVED = 0.1
"""Share of a stick's way that it must be moved for an override."""
_FASTEST, _CLIMB, _TURN = 6.0, 3.0, math.radians(90)
"""m/s and rad/s of sticks at their ends."""


@dataclass(slots=True)
class Sticks:
    """The pilot's sticks, -1 to 1: MANUAL_CONTROL, or a radio while a pilot at the field has the vehicle."""

    forward: float = 0.0
    right: float = 0.0
    up: float = 0.0
    turn: float = 0.0
    at: float = -math.inf
    """When they were read last, in vehicle seconds."""
    speed: float = 0.0
    """How fast the fastest stick moved, in ways (half a stick's) per second."""
    radio: bool = False
    """Whether a radio is on: its sticks are centred."""

    def move(self, x: int, y: int, z: int, r: int, now: float) -> None:
        """MANUAL_CONTROL: -1000..1000, `z` 0..1000."""
        before = (self.forward, self.right, self.up, self.turn)
        self.forward, self.right, self.up, self.turn = x / 1000, y / 1000, (z - 500) / 500, r / 1000
        moved = max(
            abs(one - other) for one, other in zip((self.forward, self.right, self.up, self.turn), before, strict=True)
        )
        self.speed = max(self.speed, moved / max(0.01, now - self.at)) if self.alive(now) else 0.0
        self.at = now

    def alive(self, now: float) -> bool:
        """Return whether the sticks are read."""
        return self.radio or now - self.at <= STICKS_LOST_S

    def override(self, threshold: float) -> bool:
        """Return whether the sticks were moved far and fast since the last call: ways per second."""
        fast, self.speed = self.speed, 0.0
        return threshold > 0 and fast >= threshold and max(map(abs, (self.forward, self.right, self.turn))) >= _MOVED

    def drift(self, motion: Motion, now: float) -> Drift:
        """Return the velocity that the sticks want of a vehicle."""
        forward, right = self.forward * abs(self.forward) * _FASTEST, self.right * abs(self.right) * _FASTEST
        velocity = Vector(*motion.turned(forward, right), self.up * _CLIMB)
        return Drift(velocity, now + 1.0, turn_rate=self.turn * _TURN)


MOTORS = range(101, 113)
"""PWM_MAIN_FUNCn of motors ..."""
ACTUATORS = range(301, 307)
"""... and of what DO_SET_ACTUATOR sets."""
ALWAYS = 2.0
"""COM_PREARM_MODE: outputs other than motors move disarmed, too."""
_IDLE, _HOVER = 0.1, 0.5
"""Shares of the range of a motor's pulses."""


class Outputs:
    """MAIN outputs by their numbers from 1; pulses are in microseconds."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self._values = [math.nan] * len(ACTUATORS)
        """Of the actuators, -1 to 1; NaN: never set."""
        self._shown: list[int] = []
        self.on_move: Callable[[int, int], None] = lambda output, pulse: None
        """Called with each output of an actuator and its new pulse."""

    def set(self, values: tuple[float, ...]) -> None:
        """DO_SET_ACTUATOR: all six values, -1 to 1; NaN gives the pulse of a disarmed output."""
        self._values = list(values)

    def pulses(self, *, armed: bool, airborne: bool) -> list[int]:
        """Return the pulses of all outputs, as in SERVO_OUTPUT_RAW; what was never set has its disarmed pulse."""
        motor = (_HOVER if airborne else _IDLE) if armed else math.nan
        moves = armed or self._parameters["COM_PREARM_MODE"] == ALWAYS
        return [self._pulse(output, motor, moves=moves) for output in range(1, OUTPUTS + 1)]

    def look(self, *, armed: bool, airborne: bool) -> None:
        """Report the outputs of actuators that have moved since the last look."""
        pulses = self.pulses(armed=armed, airborne=airborne)
        was, self._shown = self._shown or pulses, pulses
        for output, (old, new) in enumerate(zip(was, pulses, strict=True), 1):
            if old != new and self._function(output) in ACTUATORS:
                self.on_move(output, new)

    def _function(self, output: int) -> int:
        return int(self._parameters[f"PWM_MAIN_FUNC{output}"])

    def _pulse(self, output: int, motor: float, *, moves: bool) -> int:
        function, value = self._function(output), math.nan
        if function in MOTORS:
            value = 2 * motor - 1
        elif function in ACTUATORS and moves:
            value = self._values[function - ACTUATORS[0]]
        low, high, resting = (self._parameters[f"PWM_MAIN_{what}{output}"] for what in ("MIN", "MAX", "DIS"))
        if not math.isfinite(value):
            return int(resting)
        if int(self._parameters["PWM_MAIN_REV"]) >> (output - 1) & 1:
            value = -value
        return int(max(low, min(high, value * (high - low) / 2 + (high + low) / 2 + 0.01)))


POLYGON_IN, POLYGON_OUT, CIRCLE_IN, CIRCLE_OUT = 5001, 5002, 5003, 5004
"""Commands of fence items (MAV_CMD_NAV_FENCE_...)."""


class Fence:
    """Where the vehicle may be: uploaded polygons and circles, and the distances of GF_MAX_ parameters."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self.items: list[Item] = []

    def allows(self, at: Vector, home: Vector, chart: FlatMap) -> bool:
        """Return whether a place on the map is within the fence."""
        farthest, highest = self._parameters["GF_MAX_HOR_DIST"], self._parameters["GF_MAX_VER_DIST"]
        if (farthest > 0 and at.distance(home) > farthest) or (highest > 0 and at.up - home.up > highest):
            return False
        inside = []
        items = list(self.items)
        while items:
            first = items[0]
            if first.command in (POLYGON_IN, POLYGON_OUT):
                count = max(1, int(first.params[0]))
                corners, items = [_vector(item, chart) for item in items[:count]], items[count:]
                within = is_inside((at.north, at.east), [(corner.north, corner.east) for corner in corners])
            else:
                items = items[1:]
                within = at.distance(_vector(first, chart)) <= first.params[0]
            if first.command in (POLYGON_OUT, CIRCLE_OUT) and within:
                return False
            if first.command in (POLYGON_IN, CIRCLE_IN):
                inside.append(within)
        return any(inside) or not inside


def _vector(item: Item, chart: FlatMap) -> Vector:
    return chart.at(item.x / 1e7, item.y / 1e7, chart.origin.alt)


class Px4State(Autopilot):
    """The state of one vehicle with PX4, and whether it may be armed."""

    READY_S: ClassVar[float] = 2.7
    """When the estimator has started (recorded: a copter 1.9 to 2.9)."""
    SYSTEM_ID: ClassVar = "MAV_SYS_ID"
    FIRST_HEARTBEAT_S: ClassVar = 1.45
    mode: Mode

    def _assemble(self, before: Self | None) -> None:
        self.missions: Missions = Missions() if before is None else before.missions
        self.missions.current, self.missions.complete = 0, False
        self.fence: Fence = Fence(self.parameters) if before is None else before.fence
        self.battery = Battery(self.parameters, self.charge_time)
        self.sticks = Sticks()
        self.outputs = Outputs(self.parameters)
        self.outputs.on_move = lambda output, pulse: self.on_servo(output, pulse)
        self.links = Links()
        self.mode = self.intended = Mode.LOITER
        self.takeoff_up: float | None = None
        """Altitude on the map of the takeoff that was ordered; None: MIS_TAKEOFF_ALT above here."""
        self.setpoint: Task | None = None
        """The last setpoint for OFFBOARD ..."""
        self.setpoint_at = -math.inf
        """... and when it came, in vehicle seconds."""
        self.flown = False
        """Whether it has taken off since it was armed."""
        self.armed_at = self.landed_at = 0.0
        self._complained = False

    @property
    def age(self) -> float:
        """Seconds since the first HEARTBEAT."""
        return self.now - self.FIRST_HEARTBEAT_S

    @property
    def ready(self) -> bool:
        """Whether the estimator has started, so that it can be armed."""
        return self.age >= (self.READY_S if self.boot_kind == "real" else _QUICK_READY_S)

    @property
    def booting(self) -> bool:
        """Whether the boot sequence goes on."""
        return not self.ready

    @property
    def has_fix(self) -> bool:
        """Whether the GPS has started."""
        return True

    @property
    def has_position(self) -> bool:
        """Whether the estimator has a position."""
        return self.ready and not self.estimate.lost

    def send_text(self, text: str, severity: Severity = INFO, arguments: bytes = b"") -> None:
        """Queue a STATUSTEXT, and the EVENT of the same news with its arguments."""
        self.events.append(Text(severity, f"{text}\t"))
        if event := event_of(text):
            self.events.append(Number(*event, arguments))

    def problems(self) -> list[str]:
        """Return the failed arming checks that do not depend on the mode, in the vehicle's words."""
        if not self.ready:
            return ["no heading reference"]
        problems = [self.hindrance] if self.hindrance else []
        if self.estimate.gps is None or not self.has_position:
            problems.append("no valid global position estimate")
        if self.parameters["NAV_DLL_ACT"] > 0 and not self.links.station_present(self.now):
            problems.append("No connection to the ground control station")
        return problems

    def report_problems(self) -> None:
        """Queue the text of each failed arming check, and its EVENT."""
        for problem in self.problems():
            text = f"Preflight Fail: {problem}"
            self.events.append(Text(CRITICAL, text))
            if event := event_of(text):
                self.events.append(Number(*event))

    def mode_problem(self, mode: Mode) -> bool:
        """Return whether something that a mode needs is missing."""
        if mode.piloted:
            return not self.sticks.alive(self.now)
        if mode is Mode.MISSION:
            return not self.missions.valid
        if mode is Mode.OFFBOARD:
            return not self.setpoints_come
        return False

    @property
    def setpoints_come(self) -> bool:
        """Whether setpoints are streamed."""
        return self.now - self.setpoint_at <= self.parameters["COM_OF_LOSS_T"]

    @property
    def healthy(self) -> bool:
        """Bit 28 of SYS_STATUS: whether all checks pass in the present mode."""
        ground_only = not self.armed and self.mode in (Mode.RTL, Mode.LAND, Mode.PRECLAND, Mode.DESCEND)
        return not self.problems() and not self.mode_problem(self.mode) and not ground_only

    def _boot(self) -> None:
        if self.home is None and self.age >= _HOME_S[self.boot_kind]:
            self.set_home(self.place)
        if not self._complained and not self.ready and self.age >= _COMPLAINT_S:
            self._complained = True
            self.report_problems()
