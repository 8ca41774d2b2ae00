"""A simulated ArduPlane without MAVLink."""

from __future__ import annotations

import math
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.ardupilot import boot as boot_sequence
from bridged.simulation.vehicle.ardupilot import parameters as tables
from bridged.simulation.vehicle.ardupilot.ardupilot import UNASKED_S, ArduPilot, Texts
from bridged.simulation.vehicle.ardupilot.boot import Milestone
from bridged.simulation.vehicle.ardupilot.failsafes import StationLink
from bridged.simulation.vehicle.ardupilot.flight_modes import PlaneMode
from bridged.simulation.vehicle.ardupilot.mission import NAV_COMMANDS, goal_of
from bridged.simulation.vehicle.mission_items import Item
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.motion.plane_flight import PlaneFlight, PlaneMotion, PlaneTuning
from bridged.simulation.vehicle.motion.tasks import Approach, GoTo, Landed, Stop, TakeOff, Task
from bridged.simulation.vehicle.notifications import ItemReached, Result, Severity
from bridged.simulation.vehicle.parameters import Parameters

_WIDER = 1.15
"""A circle as it is flown, in radii of WP_LOITER_RAD (recorded: 92 m of 80 m)."""
_TRIGGERED_S, _ANNOUNCED_S = 0.2, 1.24
"""From the order to take off until it is triggered, and until the course of the takeoff is reported (recorded)."""
_LEVEL_OFF = 18.0
"""Metres below the altitude of a takeoff at which it is reported that it levels off (recorded)."""
_PREARM_S = 0.94
"""From the end of a landing's motor until failed arming checks are reported (recorded)."""
_FINAL, _FINAL_HEIGHT = 400.0, 55.0
"""Metres before the place of AUTOLAND, and above it, from where it descends (AUTOLAND_WP_DIST, AUTOLAND_WP_ALT)."""
_FLIES_S = 10.0
"""Seconds in the air after which TAKEOFF begins no takeoff any more (ArduPlane/mode_takeoff.cpp)."""
_ROLLING = 3.0
"""m/s from which a plane on the runway counts as taking off."""


def _tuning(values: Parameters, speed: float | None) -> PlaneTuning:
    return PlaneTuning(
        airspeed=max(10.0, speed or values["AIRSPEED_CRUISE"]),
        radius=_WIDER * max(20.0, values["WP_LOITER_RAD"]),
        near=values["WP_RADIUS"],
        turn_rate=0.42,
        climb=4.0,
        sink=2.6,
        takeoff_climb=8.5,
        rotation=18.0,
        thrust=9.0,
        run_delay=0.5,
        takeoff_done=1.0,
        flare_height=3.5,
        flare_sink=0.6,
        roll_out=3.0,
        touchdown_to_landed=8.7,
    )


class Plane(ArduPilot):
    """A fixed wing."""

    NAME: ClassVar = "plane"
    TYPE: ClassVar = dialect.MAV_TYPE_FIXED_WING
    LOCOMOTION: ClassVar = PlaneFlight
    TUNING: ClassVar = staticmethod(_tuning)
    ROWS: ClassVar = tables.PLANE
    SCRIPT: ClassVar = boot_sequence.PLANE
    DEFAULTS_S: ClassVar = UNASKED_S
    OUTSIDE_GUIDED: ClassVar = Result.FAILED
    TAKES_SETPOINTS: ClassVar = False
    HOME_FOLLOWS: ClassVar = True
    STATION: ClassVar = ("FS_GCS_ENABL", "FS_LONG_TIMEOUT", 0.0)
    MODES: ClassVar = PlaneMode
    INITIAL: ClassVar = PlaneMode.INITIALISING
    SWITCHED: ClassVar = PlaneMode.MANUAL
    REPORTS: ClassVar = frozenset((PlaneMode.GUIDED, PlaneMode.AUTO, PlaneMode.RTL, PlaneMode.LOITER))
    PILOTED: ClassVar = PlaneMode.LOITER
    LANDING: ClassVar = PlaneMode.AUTOLAND
    mode: PlaneMode
    flight: PlaneFlight
    motion: PlaneMotion

    _aloft_since = 0.0
    _started_at: float | None = None
    _sent: frozenset[str] = frozenset()
    """Texts of the present takeoff or landing that have been sent."""
    _takeoff_course: float | None = None
    """radians"""
    _landed_at: float | None = None
    _prearm_at: float | None = None

    @property
    def base_mode(self) -> int:
        """base_mode of HEARTBEAT."""
        sticks = 0 if self.mode is PlaneMode.INITIALISING else 64
        return 1 | 16 | sticks | (8 if self.mode.autonomous else 0) | (128 if self.armed else 0)

    @property
    def system_status(self) -> int:
        """system_status of HEARTBEAT."""
        if self.mode is PlaneMode.INITIALISING:
            return 2
        if self.station.lost:
            return 5
        return 4 if self.flight.landed is not Landed.ON_GROUND else 3

    def set_mode(self, number: int) -> Result:
        """Change the flight mode; without a mission AUTO is over immediately, and the plane returns."""
        if number != PlaneMode.AUTO or self.mode is PlaneMode.AUTO or self.mission.flyable:
            return super().set_mode(number)
        if self.mode is not PlaneMode.RTL:
            self.take_mode(PlaneMode.RTL)
            self._return()
        self.mission.complete = True
        self.send_text("Mission complete, changing mode to RTL")
        return Result.ACCEPTED

    def refusal(self, mode: PlaneMode) -> Texts:
        """Return the text by which a flight mode is refused."""
        if mode.vertical:
            return (("Q_ENABLE 0", Severity.INFO),)
        if mode is PlaneMode.AUTOLAND and (self._takeoff_course is None or not self.flight.airborne):
            return (("Takeoff initial direction not set", Severity.INFO),)
        return ()

    def enter(self, mode: PlaneMode) -> None:
        """Begin what a flight mode does."""
        self._started_at = None
        match mode:
            case PlaneMode.TAKEOFF:
                self._take_off()
            case PlaneMode.AUTO:
                self._fly_on()
            case PlaneMode.RTL:
                self._return()
            case PlaneMode.AUTOLAND:
                self._autoland()
            case _:
                self.flight.begin(Stop())
                if mode is PlaneMode.GUIDED:
                    self.events.append(ItemReached(0))
                    self._arrived = True

    def _return(self) -> None:
        if self.parameters["RTL_AUTOLAND"] > 0:
            if (start := self.mission.landing_start) is not None:
                self.take_mode(PlaneMode.AUTO)
                self._fly_from(start)
                return
            self.send_text("Unable to start landing sequence", Severity.WARNING)
        home = self.home_on_chart
        self.flight.begin(GoTo(Vector(home.north, home.east, home.up + self.parameters["RTL_ALTITUDE"])))

    def _take_off(self) -> None:
        """Take off to TKOFF_ALT above here, and circle TKOFF_DIST ahead.

        A plane that has flown for some seconds climbs to TKOFF_ALT above home instead, or circles here if it is above.
        """
        if not self.armed:
            return
        here, up = self.motion.position, self.home_on_chart.up + self.parameters["TKOFF_ALT"]
        if not self.flight.airborne or self.now - self._aloft_since <= _FLIES_S:
            self._begin_takeoff(here.up + self.parameters["TKOFF_ALT"])
        elif here.up >= up:
            self.send_text("Above TKOFF alt - loitering")
            self.flight.begin(Stop())
        else:
            self.send_text("Climbing to TKOFF alt then loitering")
            self._circle_ahead(self.motion.heading, here, up)

    def _circle_ahead(self, course: float, place: Vector, up: float) -> None:
        ahead = self.parameters["TKOFF_DIST"]
        north, east = place.north + ahead * math.cos(course), place.east + ahead * math.sin(course)
        self.flight.begin(GoTo(Vector(north, east, up)))

    def _begin_takeoff(self, up: float) -> None:
        self._started_at, self._sent = self.now, frozenset()
        self.send_text("Armed AUTO, xaccel = 0.0 m/s/s, waiting 0.2 sec")
        self.flight.begin(TakeOff(up))

    def _autoland(self) -> None:
        home, course = self.home_on_chart, self._takeoff_course or 0.0
        final = Vector(
            home.north - _FINAL * math.cos(course), home.east - _FINAL * math.sin(course), home.up + _FINAL_HEIGHT
        )
        self.flight.begin(GoTo(final, smooth=True))

    def arming_problems(self) -> list[str]:
        """Return the failed arming checks in the vehicle's words; none if the motors can be armed."""
        if not self.passed(Milestone.READY):
            return ["System not initialised"]
        problems = [self.hindrance] if self.hindrance else []
        if not self.passed(Milestone.HOME):
            problems.append("AHRS: waiting for home")
        elif not self.has_position:
            problems.append("AHRS: not using configured AHRS type")
        if self.estimate.gps is None:
            problems.append("GPS 1: Bad fix")
        if self.battery.shortage or self.battery.empty:
            problems.append("Battery failsafe")
        return problems + self._mission_problems()

    def _mission_problems(self) -> list[str]:
        start = self.mission.landing_start
        if start is None:
            return []
        problems = []
        if self.parameters["RTL_AUTOLAND"] == 0:
            problems.append("DO_LAND_START set and RTL_AUTOLAND disabled")
        if self.mission.current > start:
            problems.append("In landing sequence")
        return problems

    def has_armed(self) -> None:
        """Set home here, and begin a takeoff or mission."""
        self._landed_at = None
        self.set_home(self.place)
        self.send_text("Throttle armed")
        if self.mode in (PlaneMode.TAKEOFF, PlaneMode.AUTO):
            self._arrived = False
            self.enter(self.mode)

    def has_disarmed(self) -> None:
        """Report failed checks a little later."""
        self.send_text("Throttle disarmed")
        self._prearm_at = self.now + _PREARM_S

    def take_off(self, altitude: float) -> Result:
        """MAV_CMD_NAV_TAKEOFF: only a plane with vertical takeoff takes it."""
        del altitude
        return Result.FAILED

    def start_landing(self) -> Result:
        """MAV_CMD_DO_LAND_START: AUTO at the landing of the mission."""
        start = self.mission.landing_start
        if start is None:
            return Result.FAILED
        if self.mode is not PlaneMode.AUTO:
            self.take_mode(PlaneMode.AUTO)
            self._fly_from(start)
        self.send_text("Landing sequence start")
        self._fly_from(start)
        self.events.append(ItemReached(start))
        return Result.ACCEPTED

    def bring_home(self) -> None:
        """Switch to RTL."""
        if self.mode not in (PlaneMode.RTL, PlaneMode.AUTOLAND):
            self.set_mode(PlaneMode.RTL)

    def on_station(self, change: StationLink) -> None:
        """Act by FS_LONG_ACTN when the ground station is lost."""
        if change is StationLink.FOUND:
            self.send_text("GCS Failsafe Off", Severity.WARNING)
        elif self.flight.airborne and self.parameters["FS_LONG_ACTN"] == 1:
            self.take_mode(PlaneMode.RTL)
            self.send_text("GCS Failsafe On: RTL", Severity.WARNING)
            self._return()
        else:
            self.send_text("GCS Failsafe On", Severity.WARNING)

    def start_mission(self) -> Result:
        """MAV_CMD_MISSION_START"""
        return self.set_mode(PlaneMode.AUTO)

    def task_of(self, item: Item) -> Task:
        """Return the effect of an item of the mission."""
        home, here = self.home or self.chart.origin, self.motion.position
        goal = goal_of(item, self.chart, home)
        match item.command:
            case dialect.MAV_CMD_NAV_TAKEOFF:
                return TakeOff(self.home_on_chart.up + item.z)
            case dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH:
                at = self.home_on_chart
                return GoTo(Vector(at.north, at.east, at.up + self.parameters["RTL_ALTITUDE"]))
            case dialect.MAV_CMD_NAV_LAND:
                return Approach(goal or self.home_on_chart)
            case dialect.MAV_CMD_NAV_WAYPOINT if goal is not None:
                return GoTo(goal, smooth=True)
        return GoTo(goal or here)

    def _fly_from(self, seq: int) -> None:
        """Fly to the next place of the mission; in the air a takeoff is over, on the ground it begins."""
        for item in self.mission.items[max(0, seq - 1) :]:
            if item.command != dialect.MAV_CMD_DO_LAND_START:
                break
            self.send_text(f"Mission: {item.seq} LandStart")
        super()._fly_from(seq)
        item_now = self.mission.item(self.mission.current)
        if item_now is None or self.mission.complete:
            return
        if item_now.command == dialect.MAV_CMD_NAV_TAKEOFF:
            if self.flight.airborne:
                self._takeoff_item_over(item_now)
            elif self.armed:
                self._begin_takeoff(self.home_on_chart.up + item_now.z)
        elif item_now.command == dialect.MAV_CMD_NAV_LAND and self.flight.airborne:
            self._sent = frozenset()
            self.send_text(f"Landing approach start at {self.flight.height:.1f}m")

    def _takeoff_item_over(self, item: Item) -> None:
        self.events.append(ItemReached(item.seq))
        course = round(math.degrees(self.motion.heading) * 100)
        self.send_text(f"Holding course {course} at {self.motion.airspeed:.1f}m/s (0.5)")
        self.send_text(f"Takeoff complete at {self.flight.height:.2f}m")
        self._fly_from(item.seq + 1)

    def item_reached(self, item: Item) -> None:
        """Report that an item is done; the number is that of the last item before the next place."""
        _, after = self.mission.next_place(item.seq + 1)
        self.events.append(ItemReached(after.seq - 1 if after is not None else item.seq))
        if NAV_COMMANDS[item.command] == "WP":
            goal = self.flight.target or self.motion.position
            self.send_text(f"Reached waypoint #{item.seq} dist {self.motion.position.distance(goal):.0f}m")

    def mission_ended(self) -> None:
        """Return to home where the mission ends in the air."""
        if self.flight.airborne:
            self.take_mode(PlaneMode.RTL)
            self.send_text("Mission complete, changing mode to RTL")
            self._return()

    def _move(self, dt: float) -> None:
        flight, was = self.flight, self.flight.landed
        self._fly(dt)
        if not flight.airborne:
            self._aloft_since = self.now
        if self._started_at is not None:
            self._report_takeoff(self._started_at)
        if flight.landed is Landed.ON_GROUND and was is not Landed.ON_GROUND:
            self._landed_at = self.now
        if isinstance(flight.task, Approach):
            self._report_landing(flight.task)
        if not self.armed:
            return
        if self.mode is PlaneMode.AUTO:
            self._follow_mission()
        elif self.mode is PlaneMode.AUTOLAND and flight.reached and not isinstance(flight.task, Approach):
            flight.begin(Approach(self.home_on_chart))
        elif self.mode is PlaneMode.GUIDED and flight.reached and not self._arrived:
            self._arrived = True
            self.events.append(ItemReached(0))
        self._disarm_after_landing()

    def _send_once(self, text: str, key: str) -> None:
        if key not in self._sent:
            self._sent |= {key}
            self.send_text(text)

    def _report_takeoff(self, since: float) -> None:
        flight, passed = self.flight, self.now - since
        course = math.degrees(self.motion.heading)
        if passed >= _TRIGGERED_S:
            self._send_once("Triggered AUTO. GPS speed = 0.0", "triggered")
        if not flight.airborne and flight.rolls and self.motion.airspeed > _ROLLING:
            flight.landed = Landed.TAKEOFF
        if passed >= _ANNOUNCED_S:
            distance, up = self.parameters["TKOFF_DIST"], flight.task.up if isinstance(flight.task, TakeOff) else 0.0
            above = up - self.home_on_chart.up
            self._send_once(f"Takeoff to {above:.0f}m for {distance:.1f}m heading {course:.1f} deg", "course")
        if passed >= _ANNOUNCED_S + 0.3 and self._takeoff_course is None:
            self._takeoff_course = self.motion.heading
            self._send_once(f"Autoland direction= {course:.0f}", "autoland")
        if not isinstance(flight.task, TakeOff):
            return
        left = flight.task.up - self.motion.up.position
        if flight.airborne and left < _LEVEL_OFF and self.mode is PlaneMode.TAKEOFF:
            self._send_once(f"Takeoff level-off starting at {left:.0f}m", "level")
        if flight.reached:
            self._started_at = None
            if self.mode is PlaneMode.TAKEOFF:
                self._circle_ahead(self._takeoff_course or 0.0, self.home_on_chart, flight.task.up)

    def _report_landing(self, approach: Approach) -> None:
        flight = self.flight
        if approach.length is None:
            return
        if flight.airborne and flight.height < 0.5 * (approach.up - approach.goal.up):
            slope = math.degrees(math.atan2(approach.up - approach.goal.up, approach.length))
            self._send_once(f"Landing glide slope {slope:.1f} degrees", "slope")
        if flight.flaring:
            away = self.motion.position.distance(approach.goal)
            sink = -self.motion.up.velocity
            speed = self.motion.airspeed
            self._send_once(f"Flare {flight.height:.1f}m sink={sink:.2f} speed={speed:.1f} dist={away:.1f}", "flare")

    def _disarm_after_landing(self) -> None:
        delay = self.parameters["LAND_DISARMDELAY"]
        if self._landed_at is None or delay <= 0 or self.now - self._landed_at < delay - 0.5:
            return
        self._landed_at = None
        task = self.flight.task
        self.disarm()
        self.send_text("Auto disarmed")
        if isinstance(task, Approach):
            self.send_text(f"Distance from LAND point={self.motion.position.distance(task.goal):.2f}m")

    def _guard(self, dt: float) -> None:
        super()._guard(dt)
        if self._prearm_at is not None and self.now >= self._prearm_at:
            self._prearm_at = None
            for problem in self._mission_problems():
                self.send_text(f"PreArm: {problem}", Severity.CRITICAL)
