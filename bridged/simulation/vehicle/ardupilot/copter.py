"""A simulated ArduCopter without MAVLink: its modes, arming checks, takeoff, landing."""

from __future__ import annotations

from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.ardupilot import boot as boot_sequence
from bridged.simulation.vehicle.ardupilot import parameters as tables
from bridged.simulation.vehicle.ardupilot.ardupilot import ArduPilot
from bridged.simulation.vehicle.ardupilot.boot import Milestone
from bridged.simulation.vehicle.ardupilot.copter_tuning import TOUCHDOWN_TO_DISARM_S, copter_tuning
from bridged.simulation.vehicle.ardupilot.failsafes import StationLink
from bridged.simulation.vehicle.ardupilot.flight_modes import Mode
from bridged.simulation.vehicle.ardupilot.mission import task_of
from bridged.simulation.vehicle.geodesy import Place
from bridged.simulation.vehicle.mission_items import Item
from bridged.simulation.vehicle.motion.copter_flight import Flight
from bridged.simulation.vehicle.motion.tasks import Land, Return, Stop, TakeOff, Task
from bridged.simulation.vehicle.notifications import ItemReached, ParameterChanged, Result, Severity

_YAW_ALIGNMENT_HEIGHT = 1.9
"""m above the ground at which the compass is checked in flight (recorded text)."""
_LAND_ON_FAILSAFE = (1, 4)
"""Values of BATT_FS_LOW_ACT and BATT_FS_CRT_ACT that land; others but 0 bring the copter home."""
_ALT_HOLD, _EVEN_MANUAL = 2, 3
"""Values of FS_EKF_ACTION; others but 0 land a copter whose mode needs a position."""


class Copter(ArduPilot):
    """An ArduCopter."""

    NAME: ClassVar = "copter"
    TYPE: ClassVar = dialect.MAV_TYPE_QUADROTOR
    VTOL_STATE: ClassVar = 3
    LOCOMOTION: ClassVar = Flight
    TUNING: ClassVar = staticmethod(copter_tuning)
    ROWS: ClassVar = tables.COPTER
    SCRIPT: ClassVar = boot_sequence.COPTER
    INITIAL: ClassVar = Mode.STABILIZE
    GUIDED: ClassVar = Mode.GUIDED
    AUTO: ClassVar = Mode.AUTO
    RTL: ClassVar = Mode.RTL
    LOITER: ClassVar = Mode.LOITER
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

    def set_mode(self, number: int) -> Result:
        """Change the flight mode to that of a number (custom_mode); a status text gives the reason of a refusal.

        As in ArduCopter, a position is needed only with motors on.
        """
        try:
            mode = Mode(number)
        except ValueError:
            self.send_text(f"No such mode {number}", Severity.WARNING)
            return Result.FAILED
        if mode is self.mode:
            return Result.ACCEPTED
        problem = self._problem_with(mode)
        if problem is not None:
            self.send_text(f"Mode change to {mode.name} failed: {problem}", Severity.WARNING)
            return Result.FAILED
        self.take_mode(mode)
        match mode:
            case Mode.RTL:
                self.flight.begin(Return(self.home_on_chart))
            case Mode.LAND:
                self.flight.begin(Land())
            case Mode.AUTO:
                self._fly_from(max(1, self.mission.current))
            case _:
                self.flight.begin(Stop(hard=mode is Mode.BRAKE))
        return Result.ACCEPTED

    def _problem_with(self, mode: Mode) -> str | None:
        if not mode.simulated:
            return "not simulated"
        if self.armed and mode.needs_position and not self.has_position:
            return "requires position"
        if mode is Mode.AUTO and not self.mission.flyable:
            return "init failed"
        return None

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

    def arm(self, *, force: bool = False) -> Result:
        """Start the motors and set home here."""
        if self.armed:
            return Result.ACCEPTED
        if self.refuses_arming(force=force):
            return Result.FAILED
        self.flight.arm()
        if self.passed(Milestone.HOME):
            self.set_home(self.place)
        self.send_text("Arming motors")
        return Result.ACCEPTED

    def disarm(self, *, force: bool = False) -> Result:
        """Stop the motors; refused in the air unless forced."""
        if not self.armed:
            return Result.ACCEPTED
        if self.flight.airborne and not force:
            return Result.FAILED
        self.flight.disarm()
        if self.mode is Mode.AUTO and self.mission.current:
            self.events.append(ItemReached(self.mission.current))
            self.mission.current, self.mission.complete = 0, True
        self.send_text("Disarming motors")
        self.events.append(ParameterChanged("MOT_THST_HOVER"))
        return Result.ACCEPTED

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
        flight, was_airborne = self.flight, self.flight.airborne
        flight.step(dt)
        armed, airborne = flight.armed, flight.airborne
        self.battery.step(dt, flying=airborne and armed, effort=self.motion.effort)
        if armed and self.battery.empty:
            flight.disarm()
            self.send_text("SIM battery is empty", Severity.CRITICAL)
        if was_airborne and not airborne:
            self.send_text(f"SIM Hit ground at {flight.touchdown_speed:f} m/s")
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
        delay = TOUCHDOWN_TO_DISARM_S if landing else self.parameters["DISARM_DELAY"]
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
        """Land, or do what FS_EKF_ACTION says."""
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
