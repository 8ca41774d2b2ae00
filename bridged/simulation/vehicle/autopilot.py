"""What all simulated autopilots are: a vehicle with a place, a home, a position estimate and notifications."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, ClassVar, Literal, Self

from bridged.simulation.vehicle.geodesy import FlatMap, Place
from bridged.simulation.vehicle.motion.dynamics import Motion, Vector
from bridged.simulation.vehicle.motion.locomotion import Locomotion
from bridged.simulation.vehicle.notifications import Event, HomeChanged, Severity, Text
from bridged.simulation.vehicle.parameters import Parameters, Row


class ChargeState(IntEnum):
    """charge_state of BATTERY_STATUS (MAV_BATTERY_CHARGE_STATE)."""

    OK = 1
    LOW = 2
    CRITICAL = 3
    EMERGENCY = 4
    CHARGING = 7


CHARGE_S = 120.0
"""Vehicle seconds that an empty battery needs at home to be full, unless another time is given."""

BootKind = Literal["quick", "real"]
"""`real` takes the seconds that the recorded autopilot took (an ArduCopter 40), `quick` about 3, in the same order."""

STEP_S = 0.02
"""Vehicle seconds by which a vehicle moves at a time; what else happens takes multiples of it."""

STEADY_S = 0.1
"""The same while nothing accelerates."""

GUARD_PERIOD_S = 0.2
"""Vehicle seconds between two checks of the failsafes."""


GATE = 5.0
"""Metres between GPS and estimate that are accepted (EK3_POS_I_GATE)."""
TIMEOUT_S = 7.0
"""Seconds without an accepted GPS position after which the estimator gives in (EKF3: gpsRetryTimeNoTAS_ms)."""
NOTICED_S = 1.0
"""Seconds for which the GPS is rejected, or the position lost, before the autopilot reports it and acts."""
FOUND_S = 10.0
"""Seconds of a good GPS until an estimator without a position uses it."""


@dataclass(slots=True)
class PositionEstimate:
    """What an autopilot makes of a GPS that is lost or wrong (EKF3 of ArduPilot): horizontal errors in metres.

    A GPS position that is too far from the estimate is rejected; after `TIMEOUT_S` the estimator gives in and takes it.
    Without any GPS it goes on by its inertial sensors for as long, and then has no position: a copter that needs one
    lands (FS_EKF_ACTION), and drifts with the wind meanwhile. Times are vehicle seconds.
    """

    gps: Vector | None = field(default_factory=Vector)
    """GPS position minus the true one; None: no fix."""
    error: Vector = field(default_factory=Vector)
    """Estimated position minus the true one."""
    lost: bool = False
    """Whether there is no estimate."""
    glitching: bool = False
    """Whether the GPS is rejected."""
    failed: bool = False
    """Whether the position has been lost for long enough to act."""
    reported: tuple[bool, bool] = (False, False)
    """`glitching` and `failed`, as the autopilot has reported them."""
    _since: float | None = None
    """Since when another state than the present one is due."""
    _lost_at: float = 0.0

    def step(self, now: float) -> Vector:
        """Advance to `now`; return the shift of the estimate in metres: it jumps where it is reset to the GPS."""
        gps = self.gps
        if self.lost:
            changes, wait = gps is not None, FOUND_S
        else:
            changes, wait = gps is None or gps.distance(self.error) > GATE, TIMEOUT_S
        self._since = None if not changes else now if self._since is None else self._since
        if self._since is not None and now - self._since >= wait:
            self._since, self.lost, self._lost_at = None, gps is None, now
        self.failed = self.lost and now - self._lost_at >= NOTICED_S
        rejects = gps is not None and not self.lost and self._since is not None
        self.glitching = rejects and self._since is not None and now - self._since >= NOTICED_S
        if gps is None or self.lost or self._since is not None:
            return Vector()
        shift = Vector(gps.north - self.error.north, gps.east - self.error.east)
        self.error = Vector(gps.north, gps.east)
        return shift

    def drift(self, air: Vector, dt: float) -> None:
        """Let a copter that does not know where it is be carried away by the air for `dt` seconds."""
        self.error = Vector(self.error.north - air.north * dt, self.error.east - air.east * dt)


class Autopilot(ABC):
    """One vehicle from power on. Time passes only in `step`; notifications gather in `events`."""

    PILOTED: ClassVar[IntEnum]
    """The mode that a pilot at the field sets when he takes the vehicle in the air ..."""
    LANDING: ClassVar[IntEnum]
    """... and the one in which he lands it."""
    GIVEN_BACK: ClassVar[IntEnum | None] = None
    """The mode in which he gives it back; None = that in which it was, which hands an ArduPilot over to its agents."""
    NAME: ClassVar[str]
    """`copter`, `plane` or `rover`."""
    TYPE: ClassVar[int]
    """MAV_TYPE"""
    ROWS: ClassVar[Sequence[Row]]
    """Its parameters."""
    SYSTEM_ID: ClassVar[str]
    """The parameter of its system id."""
    FIRST_HEARTBEAT_S: ClassVar[float]
    """Seconds after power on at which it sends its first HEARTBEAT, and from which its boot sequence counts."""
    LOCOMOTION: ClassVar[type[Locomotion[Any]]]
    TUNING: ClassVar[staticmethod[[Parameters, float | None], Any]]
    """How it moves by its parameters."""
    mode: IntEnum
    flight: Any
    """Its `LOCOMOTION`."""

    def __init__(
        self,
        start: Place,
        parameters: Parameters | None = None,
        heading: float = 0.0,
        boot: BootKind = "quick",
        charge_time: float = CHARGE_S,
        before: Self | None = None,
    ) -> None:
        """`heading` in radians; at home an empty battery is full after `charge_time` seconds. `before`: the autopilot
        before a restart, whose memory is kept."""
        self.now = self.FIRST_HEARTBEAT_S
        self.parameters = parameters or Parameters(self.ROWS)
        self.boot_kind = boot
        self.charge_time = charge_time
        self.chart = FlatMap(start)
        self.flight = self.LOCOMOTION.by_parameters(heading, self.parameters, self.TUNING)
        self.motion: Motion = self.flight.motion
        self.estimate = PositionEstimate()
        self.hindrance = ""
        """An arming check that fails by a fault, in the vehicle's words."""
        self.home: Place | None = None
        self.home_on_chart = Vector()
        """Home on the map; the place of power on before home is set."""
        self.events: list[Event] = []
        self.next_guard = 0.0
        """When the failsafes are checked next, in vehicle seconds."""
        self.on_servo: Callable[[int, int], None] = lambda output, pulse: None
        """Called with each output and its new pulse in microseconds."""
        self._assemble(before)

    @abstractmethod
    def _assemble(self, before: Self | None) -> None:
        """Make the parts of the autopilot, at power on; `before`: the autopilot before a restart."""

    @property
    @abstractmethod
    def booting(self) -> bool:
        """Whether the boot sequence goes on."""

    @property
    @abstractmethod
    def has_position(self) -> bool:
        """Whether the estimator has a position."""

    @abstractmethod
    def pilot_sets(self, number: int) -> None:
        """Change the flight mode to that of a number, as a pilot at the field does by his switch."""

    def restarted(self, place: Place) -> Self:
        """Return the autopilot after a restart at a place on the ground: what it has stored is kept."""
        return type(self)(place, self.parameters, self.motion.heading, self.boot_kind, self.charge_time, before=self)

    @property
    def armed(self) -> bool:
        """Whether the motors turn."""
        return bool(self.flight.armed)

    @property
    def in_motion(self) -> bool:
        """Whether its motors turn, or it falls or has just come down."""
        return bool(self.flight.armed or self.flight.airborne) or self.flight.touchdown_at is not None

    @property
    def place(self) -> Place:
        """Position of the vehicle as the autopilot estimates it: its motion is controlled by that."""
        return self.chart.place(self.motion.position)

    @property
    def truth(self) -> Vector:
        """True position on the map."""
        at, error = self.motion.position, self.estimate.error
        return Vector(at.north - error.north, at.east - error.east, at.up)

    @property
    def true_place(self) -> Place:
        """True position."""
        return self.chart.place(self.truth)

    @property
    @abstractmethod
    def has_fix(self) -> bool:
        """Whether the GPS has started."""

    @property
    def gps_place(self) -> Place | None:
        """Position that the GPS reports; None without a fix."""
        truth, gps = self.truth, self.estimate.gps
        if gps is None or not self.has_fix:
            return None
        return self.chart.place(Vector(truth.north + gps.north, truth.east + gps.east, truth.up))

    def send_text(self, text: str, severity: Severity = Severity.INFO) -> None:
        """Queue a STATUSTEXT."""
        self.events.append(Text(severity, text))

    def set_home(self, place: Place) -> None:
        """Set home."""
        self.home, self.home_on_chart = place, self.chart.vector(place)
        self.events.append(HomeChanged())

    def feel(self, air: Vector, gps: Vector | None, dt: float) -> None:
        """Let wind (m/s) and an error of the GPS (metres; None: no fix) act for `dt` seconds.

        A vehicle without a position levels, and goes where the air goes.
        """
        estimate = self.estimate
        estimate.gps, self.motion.air = gps, air
        self.motion.shift(estimate.step(self.now))
        if estimate.lost:
            self.motion.air = Vector()
            if self.flight.airborne:
                estimate.drift(air, dt)

    def step(self, dt: float) -> None:
        """Advance by `dt` seconds."""
        end = self.now + dt
        while self.in_motion and (left := end - self.now) > 1e-9:
            step = min(left, STEADY_S if self.flight.airborne and self.motion.steady else STEP_S)
            self.flight.now = self.now = self.now + step
            self._move(step)
        self.flight.now = self.now = end
        self._boot()
        if self.now >= self.next_guard:
            self.next_guard = self.now + GUARD_PERIOD_S
            self._guard(GUARD_PERIOD_S)

    @abstractmethod
    def _move(self, dt: float) -> None:
        """Move for `dt` seconds."""

    @abstractmethod
    def _boot(self) -> None:
        """Go on with the boot sequence."""

    @abstractmethod
    def _guard(self, dt: float) -> None:
        """Check the failsafes; the last check was `dt` seconds ago."""
