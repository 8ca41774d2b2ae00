"""A simulated ArduCopter without MAVLink: its modes, arming checks, takeoff, landing."""

from __future__ import annotations

import math
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.ardupilot import boot as boot_sequence
from bridged.simulation.vehicle.ardupilot import parameters as tables
from bridged.simulation.vehicle.ardupilot.ardupilot import ArduPilot, Texts
from bridged.simulation.vehicle.ardupilot.boot import Milestone
from bridged.simulation.vehicle.ardupilot.failsafes import StationLink
from bridged.simulation.vehicle.ardupilot.flight_modes import Mode
from bridged.simulation.vehicle.ardupilot.mission import task_of
from bridged.simulation.vehicle.geodesy import Place
from bridged.simulation.vehicle.mission_items import Item
from bridged.simulation.vehicle.motion.copter_flight import Flight, Tuning
from bridged.simulation.vehicle.motion.dynamics import Limits
from bridged.simulation.vehicle.motion.tasks import GoTo, Land, Return, Stop, TakeOff, Task
from bridged.simulation.vehicle.notifications import ItemReached, ParameterChanged, Result, Severity
from bridged.simulation.vehicle.parameters import Parameters

_YAW_ALIGNMENT_HEIGHT = 1.9
"""m above the ground at which the compass is checked in flight (recorded text)."""
_LAND_ON_FAILSAFE = (1, 4)
"""Values of BATT_FS_LOW_ACT and BATT_FS_CRT_ACT that land; others but 0 bring the copter home."""
_ALT_HOLD, _EVEN_MANUAL = 2, 3
"""Values of FS_EKF_ACTION; others but 0 land a copter whose mode needs a position."""


_SPOOL_UP_S = 3.3
"""From arming until the motors can lift (recorded: 5 cm high 3.7 s after arming)."""

_LIFT_DELAY_S = 0.98
"""From the takeoff command until the copter moves (recorded: 5 cm high 1.4 s after it)."""

_RETURN_PAUSE_S = 1.5
"""Time between the arrival over home and the loiter time of RTL (recorded)."""

_TOUCHDOWN_TO_LANDED_S = 1.7
_TOUCHDOWN_TO_DISARM_S = 2.09

_SMOOTH_PACE = 1.12
"""A smooth leg of L metres peaks at this times the root of L in m/s (recorded: 6.8 on 40 m, 7.8 on 50 m)."""

_STOP = Limits(accel=2.5)
_HARD_STOP = Limits(accel=3.4, release=1.1)


def _tuning(values: Parameters, cruise_speed: float | None) -> Tuning:
    speed = cruise_speed or max(0.2, values["WPNAV_SPEED"] / 100)
    climb, descent = max(0.1, values["WPNAV_SPEED_UP"] / 100), max(0.1, values["WPNAV_SPEED_DN"] / 100)
    slow = max(0.3, values["LAND_SPEED"] / 100)
    fast = max(slow, values["LAND_SPEED_HIGH"] / 100 or values["WPNAV_SPEED_DN"] / 100)
    low = values["LAND_ALT_LOW"] / 100 + 0.25
    cone, highest = values["RTL_CONE_SLOPE"], values["RTL_ALT"] / 100

    def smooth(length: float) -> Limits:
        pace = min(speed, max(1.0, _SMOOTH_PACE * math.sqrt(length)))
        return Limits(pace, climb, descent, 2.2, 1.5, 1.0, 0.9, 1.0, 0.9, response=0.9)

    def takeoff(height: float, rising: float) -> Limits:
        # Near the ground the copter first creeps, then jumps off: recorded shape of the first metre.
        accel = 0.6 if rising < 0.4 and height < 0.2 else 2.9 if rising < 1.15 and height < 0.4 else 1.05
        if height > 1.0:
            accel = 1.1
        return Limits(climb=climb, climb_accel=accel, jerk=40.0)

    def landing(height: float) -> float:
        above = height - low
        return min(fast, math.sqrt(slow * slow + 2.4 * above)) if above > 0 else slow

    return Tuning(
        legs=Limits(speed, climb, descent),
        smooth=smooth,
        drift=_STOP,
        circle=_STOP,
        stop=_STOP,
        hard_stop=_HARD_STOP,
        landing=_STOP,
        spool_up=_SPOOL_UP_S,
        lift_delay=_LIFT_DELAY_S,
        takeoff=takeoff,
        takeoff_done=lambda off, rising: off < 0.03 or (off < 0.15 and rising < 0.15),
        radius=values["WPNAV_RADIUS"] / 100,
        return_height=lambda away: min(highest, cone * away if cone > 0 else math.inf),
        over_home=1.0,
        return_wait=_RETURN_PAUSE_S + values["RTL_LOIT_TIME"] / 1000,
        descent=landing,
        touchdown_to_landed=_TOUCHDOWN_TO_LANDED_S,
    )


class Copter(ArduPilot):
    """An ArduCopter."""

    NAME: ClassVar = "copter"
    TYPE: ClassVar = dialect.MAV_TYPE_QUADROTOR
    VTOL_STATE: ClassVar = 3
    LOCOMOTION: ClassVar = Flight
    TUNING: ClassVar = staticmethod(_tuning)
    ROWS: ClassVar = tables.COPTER
    SCRIPT: ClassVar = boot_sequence.COPTER
    MODES: ClassVar = Mode
    INITIAL: ClassVar = Mode.STABILIZE
    SWITCHED: ClassVar = Mode.STABILIZE
    REPORTS: ClassVar = frozenset((Mode.GUIDED, Mode.RTL))
    PILOTED: ClassVar = Mode.LOITER
    LANDING: ClassVar = Mode.LAND
    mode: Mode
    flight: Flight
    _compass_checked = False

    @property
    def base_mode(self) -> int:
        """base_mode of HEARTBEAT."""
        guided = 8 if self.mode.autonomous or not self.passed(Milestone.READY) else 0
        return 1 | 16 | 64 | guided | (128 if self.armed else 0)

    @property
    def system_status(self) -> int:
        """system_status of HEARTBEAT."""
        return 1 if not self.passed(Milestone.READY) else 4 if self.armed and self.flight.airborne else 3

    @property
    def reports_target(self) -> bool:
        """Whether POSITION_TARGET_GLOBAL_INT is sent: on every leg, too."""
        return super().reports_target or isinstance(self.flight.task, GoTo)

    @property
    def effort(self) -> float:
        """Current that the motors draw in the air, in multiples of that of a hover."""
        return self.motion.effort

    def enter(self, mode: Mode) -> None:
        """Begin what a flight mode does."""
        match mode:
            case Mode.RTL:
                self.flight.begin(Return(self.home_on_chart))
            case Mode.LAND:
                self.flight.begin(Land())
            case Mode.AUTO:
                self._fly_from(max(1, self.mission.current))
            case _:
                self.flight.begin(Stop(hard=mode is Mode.BRAKE))

    def refusal(self, mode: Mode) -> Texts:
        """Return the text by which a flight mode is refused. As in ArduCopter, a position is needed with motors on."""
        if not mode.simulated:
            problem = "not simulated"
        elif self.armed and mode.needs_position and not self.has_position:
            problem = "requires position"
        elif mode is Mode.AUTO and not self.mission.flyable:
            problem = "init failed"
        else:
            return ()
        return ((f"Mode change to {mode.name} failed: {problem}", Severity.WARNING),)

    def arming_problems(self) -> list[str]:
        """Return the failed arming checks in the vehicle's words; none if the motors can be armed."""
        if not self.passed(Milestone.READY):
            return ["System not initialised"]
        if not self.passed(Milestone.EKF_YAW):
            return ["Need Alt Estimate"]
        if not self.passed(Milestone.ACCELS_AGREE):
            return ["Accels inconsistent"]
        problems = [self.hindrance] if self.hindrance else []
        if not self.passed(Milestone.HOME):
            problems.append("AHRS: waiting for home")
        if not self.passed(Milestone.GYROS_AGREE):
            problems.append("Gyros inconsistent")
        if not self.mode.armable:
            problems.append(f"{self.mode.name} mode not armable")
        elif self.mode.needs_position and not self.has_position:
            problems.append("Need Position Estimate")
        if self.estimate.gps is None:
            problems.append("GPS 1: Bad fix")
        if self.home is not None and self.fence.breach(self.motion.position, self.home_on_chart):
            problems.append("vehicle outside fence")
        if self.battery.shortage or self.battery.empty:
            problems.append("Battery failsafe")
        return problems

    def has_armed(self) -> None:
        """Set home here."""
        if self.passed(Milestone.HOME):
            self.set_home(self.place)
        self.send_text("Arming motors")

    def has_disarmed(self) -> None:
        """End the mission."""
        if self.mode is Mode.AUTO and self.mission.current:
            self.events.append(ItemReached(self.mission.current))
            self.mission.current, self.mission.complete = 0, True
        self.send_text("Disarming motors")
        self.events.append(ParameterChanged("MOT_THST_HOVER"))

    def set_home(self, place: Place) -> None:
        """Set home; a return goes on to it."""
        super().set_home(place)
        if isinstance(self.flight.task, Return):
            self.flight.begin(Return(self.home_on_chart))

    def take_off(self, altitude: float) -> Result:
        """Climb to `altitude` metres above home; only in GUIDED, armed and on the ground."""
        if self.mode is not Mode.GUIDED or not self.armed or self.flight.airborne or not 0 < altitude <= 10_000:
            return Result.FAILED
        self.flight.begin(TakeOff(self.home_on_chart.up + altitude))
        return Result.ACCEPTED

    def land(self) -> Result:
        """MAV_CMD_NAV_LAND"""
        return self.set_mode(Mode.LAND)

    def _move(self, dt: float) -> None:
        self._fly(dt)
        flight, airborne = self.flight, self.flight.airborne
        if not airborne:
            self._compass_checked = False
        elif not self._compass_checked and flight.height > _YAW_ALIGNMENT_HEIGHT:
            self._compass_checked = True
            for unit in (0, 1):
                self.send_text(f"EKF3 IMU{unit} MAG0 in-flight yaw alignment complete")
        if self.mode is Mode.AUTO and flight.armed:
            self._follow_mission()
        if not airborne:
            self._disarm_when_idle()

    def _disarm_when_idle(self) -> None:
        flight, idle_since = self.flight, self.flight.idle_since
        if idle_since is None:
            return
        landing = flight.touchdown_at is not None and isinstance(flight.task, Land | Return)
        delay = _TOUCHDOWN_TO_DISARM_S if landing else self.parameters["DISARM_DELAY"]
        if delay > 0 and self.now - idle_since >= delay:
            self.disarm()

    def bring_home(self) -> None:
        """Switch to RTL, or to LAND where that is refused."""
        if self.mode not in (Mode.RTL, Mode.LAND) and self.set_mode(Mode.RTL) is not Result.ACCEPTED:
            self.set_mode(Mode.LAND)

    def on_station(self, change: StationLink) -> None:
        """Act when the ground station is lost."""
        if change is StationLink.LOST and self.flight.airborne:
            self.bring_home()
        self.send_text(change.value, Severity.WARNING)

    def on_position_lost(self) -> None:
        """Land, or act by FS_EKF_ACTION."""
        action = int(self.parameters["FS_EKF_ACTION"])
        if action and (self.mode.needs_position or action == _EVEN_MANUAL) and self.mode is not Mode.LAND:
            mode = Mode.ALT_HOLD if action == _ALT_HOLD else Mode.LAND
            self.set_mode(mode)
            self.send_text(f"EKF Failsafe: changed to {mode.name} Mode", Severity.CRITICAL)

    def on_fence(self, action: int) -> None:
        """Act when the fence is breached, by FENCE_ACTION."""
        match action:
            case 0:
                return
            case 2:
                self.set_mode(Mode.LAND)
            case 4:
                self.set_mode(Mode.BRAKE)
            case _:
                self.bring_home()

    def on_shortage(self, action: int) -> None:
        """Act when the battery is low, by the BATT_FS_ parameters."""
        if action in _LAND_ON_FAILSAFE:
            self.set_mode(Mode.LAND)
        else:
            self.bring_home()

    def start_mission(self) -> Result:
        """MAV_CMD_MISSION_START: AUTO from its first item."""
        if not self.mission.flyable:
            return Result.FAILED
        if self.mode is not Mode.AUTO:
            return self.set_mode(Mode.AUTO)
        if self.armed and not self.flight.airborne:
            self._begin_item(self.mission.item(self.mission.current))
        return Result.ACCEPTED

    def task_of(self, item: Item) -> Task:
        """Return the effect of an item of the mission."""
        return task_of(item, self.flight, self.chart, self.home or self.chart.origin)
