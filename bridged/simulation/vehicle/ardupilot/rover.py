"""A simulated Rover of ArduPilot without MAVLink."""

from __future__ import annotations

import math
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.ardupilot import boot as boot_sequence
from bridged.simulation.vehicle.ardupilot import parameters as tables
from bridged.simulation.vehicle.ardupilot.ardupilot import UNASKED_S, ArduPilot, Texts
from bridged.simulation.vehicle.ardupilot.boot import Milestone
from bridged.simulation.vehicle.ardupilot.failsafes import StationLink
from bridged.simulation.vehicle.ardupilot.flight_modes import RoverMode
from bridged.simulation.vehicle.ardupilot.mission import NAV_COMMANDS, goal_of
from bridged.simulation.vehicle.geodesy import Place
from bridged.simulation.vehicle.mission_items import Item
from bridged.simulation.vehicle.motion.rover_drive import RoverDrive, RoverTuning
from bridged.simulation.vehicle.motion.tasks import Drift, GoTo, Stop, Task
from bridged.simulation.vehicle.notifications import ItemReached, Result, Severity
from bridged.simulation.vehicle.parameters import Parameters

SETPOINT_LASTS_S = 3.0
"""Seconds after the last velocity at which a rover stops."""
_FIRST_HOME = 0.2
"""Altitude of home in metres until the first disarming, as the recorded rover had it (with `boot` real)."""
_SMART_S = 3.0
"""Seconds until a rover leaves in SMART_RTL; it drives home straight."""
_ACCEL = 1.25
"""m/s² (recorded)."""
_FAILSAFE_ACTIONS = {1: RoverMode.RTL, 2: RoverMode.HOLD}
"""FS_ACTION"""


def _tuning(values: Parameters, speed: float | None) -> RoverTuning:
    return RoverTuning(
        speed=speed or values["WP_SPEED"],
        accel=_ACCEL,
        brake=0.68,
        turn_rate=math.radians(70),
        radius=values["WP_RADIUS"],
        roll_out=1.75,
        delay=0.75,
    )


class Rover(ArduPilot):
    """A rover that steers by its wheels."""

    NAME: ClassVar = "rover"
    TYPE: ClassVar = dialect.MAV_TYPE_GROUND_ROVER
    LOCOMOTION: ClassVar = RoverDrive
    TUNING: ClassVar = staticmethod(_tuning)
    ROWS: ClassVar = tables.ROVER
    SCRIPT: ClassVar = boot_sequence.ROVER
    DEFAULTS_S: ClassVar = UNASKED_S
    OUTSIDE_GUIDED: ClassVar = Result.FAILED
    DISARMS_UNDER_WAY: ClassVar = True
    REACHED: ClassVar = "waypoint"
    HOME_FOLLOWS: ClassVar = True
    STATION: ClassVar = ("FS_GCS_ENABLE", "FS_GCS_TIMEOUT", 0.8)
    MODES: ClassVar = RoverMode
    INITIAL: ClassVar = RoverMode.INITIALISING
    SWITCHED: ClassVar = RoverMode.MANUAL
    REPORTS: ClassVar = frozenset((RoverMode.GUIDED, RoverMode.AUTO, RoverMode.RTL, RoverMode.SMART_RTL))
    PILOTED: ClassVar = RoverMode.MANUAL
    LANDING: ClassVar = RoverMode.HOLD
    mode: RoverMode
    flight: RoverDrive
    _smart_at = math.inf

    @property
    def base_mode(self) -> int:
        """base_mode of HEARTBEAT."""
        sticks = 64 if self.mode in (RoverMode.MANUAL, RoverMode.INITIALISING) else 0
        return 1 | sticks | (8 if self.mode.autonomous else 0) | (128 if self.armed else 0)

    @property
    def system_status(self) -> int:
        """system_status of HEARTBEAT."""
        if self.mode is RoverMode.INITIALISING:
            return 2
        return 5 if self.station.missing(self.now) else 3 if self.mode is RoverMode.HOLD else 4

    @property
    def landed_state(self) -> int:
        """A rover reports none."""
        return 0

    @property
    def setpoint_lasts(self) -> float:
        """Seconds after which a velocity that was sent once ends."""
        return SETPOINT_LASTS_S

    def enter(self, mode: RoverMode) -> None:
        """Begin what a mode does."""
        match mode:
            case RoverMode.RTL:
                self.flight.begin(GoTo(self.home_on_chart))
            case RoverMode.SMART_RTL:
                self._smart_at = self.now + _SMART_S
                self.flight.begin(Stop(hard=True))
            case RoverMode.AUTO:
                self._fly_on()
            case _:
                self.flight.begin(Stop(hard=mode is not RoverMode.HOLD))

    def refusal(self, mode: RoverMode) -> Texts:
        """Return the texts by which a mode is refused: a reason, if there is one, and that it is."""
        failed = ("Flight mode change failed", Severity.WARNING)
        if mode is RoverMode.AUTO and not self.mission.flyable:
            return ("No Mission. Can't set AUTO.", Severity.NOTICE), failed
        if mode is RoverMode.DOCK:
            return ("Dock: target not acquired", Severity.NOTICE), failed
        if mode is RoverMode.FOLLOW or (mode.autonomous and self.armed and not self.has_position):
            return (failed,)
        return ()

    def arming_problems(self) -> list[str]:
        """Return the failed arming checks in the vehicle's words; none if the motors can be armed."""
        if not self.passed(Milestone.READY):
            return ["System not initialised"]
        problems = [self.hindrance] if self.hindrance else []
        if not self.passed(Milestone.HOME):
            problems.append("AHRS: waiting for home")
        if self.mode.autonomous and not self.has_position:
            problems.append("Need Position Estimate")
        if self.estimate.gps is None:
            problems.append("GPS 1: Bad fix")
        return problems

    def has_armed(self) -> None:
        """Go on with the mission."""
        self.send_text("Throttle armed")
        if self.mode is RoverMode.AUTO:
            self._begin_item(self.mission.item(max(1, self.mission.current)))

    def has_disarmed(self) -> None:
        """Let the mission begin with its first item the next time, unless AUTO drives it."""
        if self.mode is not RoverMode.AUTO:
            self.mission.rewind()
        self.send_text("Throttle disarmed")

    def bring_home(self) -> None:
        """Act by FS_ACTION."""
        mode = _FAILSAFE_ACTIONS.get(int(self.parameters["FS_ACTION"]))
        if mode is not None:
            self.set_mode(mode)

    def on_station(self, change: StationLink) -> None:
        """Act when the ground station is lost."""
        if change is StationLink.LOST:
            self.bring_home()
            self.send_text("Radio Failsafe", Severity.WARNING)
        else:
            self.send_text(change.value)

    def on_position_lost(self) -> None:
        """Stop."""
        if self.mode.autonomous:
            self.set_mode(RoverMode.HOLD)

    def start_mission(self) -> Result:
        """MAV_CMD_MISSION_START: AUTO from the first item if the mission is over."""
        return self.set_mode(RoverMode.AUTO)

    def task_of(self, item: Item) -> Task:
        """Return the effect of an item of the mission."""
        home = self.home or self.chart.origin
        if item.command == dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            return GoTo(self.home_on_chart)
        goal = goal_of(item, self.chart, home)
        if goal is None or item.command == dialect.MAV_CMD_NAV_DELAY:
            return Stop()
        after = self.mission.item(item.seq + 1)
        passes = after is not None and after.command in NAV_COMMANDS and item.params[0] <= 0
        return GoTo(goal, smooth=passes)

    def mission_ended(self) -> None:
        """Stop; the mode stays."""
        self.send_text("Mission Complete", Severity.NOTICE)
        self.flight.begin(Stop())

    def _reach(self, milestone: Milestone | None, texts: Texts) -> None:
        super()._reach(milestone, texts)
        if milestone is Milestone.HOME and self.boot.kind == "real":
            self.set_home(Place(self.place.lat, self.place.lon, _FIRST_HOME))

    def _move(self, dt: float) -> None:
        flight, drifted = self.flight, isinstance(self.flight.task, Drift)
        flight.step(dt)
        self.battery.step(dt, flying=self.armed and abs(flight.speed) > 0.2, effort=0.1)
        if drifted and isinstance(flight.task, Stop):
            self.send_text("target not received last 3secs, stopping", Severity.WARNING)
        if self.mode is RoverMode.SMART_RTL and self.now >= self._smart_at:
            self._smart_at = math.inf
            flight.begin(GoTo(self.home_on_chart))
        if self.mode is RoverMode.AUTO and self.armed:
            self._follow_mission()
        elif flight.reached and not self._arrived and isinstance(flight.task, GoTo):
            self._arrived = True
            if self.mode is RoverMode.GUIDED:
                self.events.append(ItemReached(0))
            elif self.mode in (RoverMode.RTL, RoverMode.SMART_RTL):
                self.send_text("Reached destination")
