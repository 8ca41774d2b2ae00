"""The simulated PX4 without MAVLink: arming, modes, takeoff and landing."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import ClassVar, Self

from bridged.simulation.vehicle.mission_items import Item
from bridged.simulation.vehicle.motion.dynamics import Limits, Vector
from bridged.simulation.vehicle.motion.tasks import Circle, GoTo, Landed, Return, Stage, Stop, TakeOff, Task
from bridged.simulation.vehicle.notifications import Result
from bridged.simulation.vehicle.px4 import missions
from bridged.simulation.vehicle.px4.failsafes import Failsafes
from bridged.simulation.vehicle.px4.modes import Mode, name_of
from bridged.simulation.vehicle.px4.navigator import Navigator
from bridged.simulation.vehicle.px4.state import Px4State
from bridged.simulation.vehicle.px4.texts import CRITICAL

PREFLIGHT_EXTRA_S = 1.15
"""Besides COM_DISARM_PRFLT, until a vehicle that does nothing is disarmed (recorded)."""


class Px4(Px4State):
    """One vehicle with PX4."""

    PILOTED: ClassVar = Mode.POSCTL
    LANDING: ClassVar = Mode.LAND
    GIVEN_BACK: ClassVar = Mode.RTL
    DETECTED_S: ClassVar[float] = 0.0
    """Seconds before it leaves the ground at which a takeoff is detected."""

    def _assemble(self, before: Self | None) -> None:
        super()._assemble(before)
        self.failsafes = Failsafes(self)
        self.navigator = Navigator(self)
        self._returning = False

    def arm(self, *, force: bool = False) -> Result:
        """Start the motors and set home here."""
        if self.armed:
            return Result.ACCEPTED
        if not self.healthy and not force:
            self.send_text("Arming denied: Resolve system health failures first", CRITICAL)
            self.report_problems()
            return Result.TEMPORARILY_REJECTED
        self.flight.arm()
        self.armed_at, self.flown = self.now, False
        self.set_home(self.place)
        self.send_text("Armed by external command")
        if self.mode in (Mode.TAKEOFF, Mode.MISSION):
            self._enter(self.mode)
        return Result.ACCEPTED

    def disarm(self, by: str, *, force: bool = False) -> Result:
        """Stop the motors; refused in the air unless forced."""
        if not self.armed:
            return Result.ACCEPTED
        if self.flight.airborne and not force:
            self.send_text("Disarming denied: not landed", CRITICAL)
            return Result.TEMPORARILY_REJECTED
        self.flight.disarm()
        self.flight.begin(Stop())
        self.failsafes.clear()
        self.send_text(f"Disarmed by {by}")
        if not self.flight.airborne:
            self.set_home(self.place)
        if self.intended in (Mode.TAKEOFF, Mode.LAND, Mode.PRECLAND, Mode.RTL, Mode.ORBIT):
            self.intended = Mode.LOITER
        self.mode = self.intended
        return Result.ACCEPTED

    def set_mode(self, number: int) -> Result:
        """Change the mode as somebody wants it; in flight it must be possible. A change ends a failsafe."""
        mode = Mode(number)
        if self.armed and self.mode_problem(mode):
            self.send_text(f"Switching to {name_of(mode)} is currently not available", CRITICAL)
            return Result.TEMPORARILY_REJECTED
        self.failsafes.overruled()
        self.intended = mode
        self.switch_to(mode)
        return Result.ACCEPTED

    def pilot_sets(self, number: int) -> None:
        """Change the mode as a pilot does, whose radio is on while he has the vehicle."""
        self.sticks.radio = number in (self.PILOTED, self.LANDING)
        self.set_mode(number)

    def switch_to(self, mode: Mode) -> None:
        """Do what a mode does, whatever was wanted; nothing new if it is the present one."""
        if mode is self.mode:
            return
        self.mode = mode
        self._returning = False
        self._enter(mode)

    def settle_in(self, mode: Mode, task: Task | None = None) -> None:
        """Change to a mode by itself, where the present one has ended; `task` is what it does there."""
        if self.intended is self.mode:
            self.intended = mode
        self.switch_to(mode)
        if task is not None:
            self.flight.begin(task)

    def _enter(self, mode: Mode) -> None:
        match mode:
            case Mode.TAKEOFF:
                self._take_off()
            case Mode.MISSION:
                self.navigator.start()
            case Mode.RTL:
                self._begin_return()
            case Mode.LAND | Mode.PRECLAND:
                self.flight.begin(self.landing())
            case Mode.OFFBOARD:
                self.flight.begin(self.setpoint or self.holding())
            case Mode.ORBIT:
                pass  # its task comes with it
            case _:
                self.flight.begin(self.holding())

    def take_off(self, altitude: float) -> Result:
        """NAV_TAKEOFF to an altitude in metres above mean sea level; NaN: MIS_TAKEOFF_ALT above here."""
        self.takeoff_up = altitude - self.chart.origin.alt if math.isfinite(altitude) else None
        if self.mode is Mode.TAKEOFF:
            self.mode = Mode.LOITER
        return self.set_mode(Mode.TAKEOFF)

    def _take_off(self) -> None:
        if not self.armed:
            return
        up, here = self.takeoff_up, self.motion.up.position
        if up is None:
            up = here + self.parameters["MIS_TAKEOFF_ALT"]
            self.send_text(f"Using default takeoff altitude: {self.parameters['MIS_TAKEOFF_ALT']:.1f} m")
        if up <= here:
            self.send_text("Already higher than takeoff altitude", CRITICAL)
            self.flight.begin(self.holding())
        else:
            self.begin_takeoff(up)

    @abstractmethod
    def begin_takeoff(self, up: float) -> None:
        """Take off to an altitude on the map."""

    def holding(self) -> Task:
        """Return what it does in AUTO.LOITER without a target."""
        return Stop()

    @abstractmethod
    def landing(self) -> Task:
        """Return what it does in AUTO.LAND."""

    @abstractmethod
    def going(self, goal: Vector, heading: float | None = None, radius: float = math.nan) -> Task:
        """Return how it goes to a goal and stays there; heading in radians, radius of a circle in metres."""

    def _begin_return(self) -> None:
        self.flight.cruise_speed = None
        self.flight.begin(self.returning())
        if self.armed and self.flight.airborne:
            self._announce_return()

    def returning(self) -> Task:
        """Return what it does in AUTO.RTL."""
        return Return(self.home_on_chart)

    def return_height(self) -> float:
        """Return the height above home of a return from here, in metres; a rover reports it and stays down."""
        return self.parameters["RTL_RETURN_ALT"]

    def _announce_return(self) -> None:
        self._returning = True
        above = max(self.return_height(), self.motion.up.position - self.home_on_chart.up)
        home = self.home or self.chart.origin
        self.send_text(f"RTL: start return at {math.ceil(home.alt + above)} m ({math.ceil(above)} m above destination)")

    def reposition(self, goal: Vector | None, speed: float, heading: float | None, radius: float) -> None:
        """Go to a goal and stay there; None: stay here."""
        if goal is not None and not self.fence.allows(goal, self.home_on_chart, self.chart):
            self.send_text("Reposition is outside geofence", CRITICAL)
            return
        self.set_mode(Mode.LOITER)
        if self.flight.airborne:
            self.flight.cruise_speed = speed if speed > 0 else None
            self.flight.begin(self.holding() if goal is None else self.going(goal, heading, radius))

    def change_altitude(self, altitude: float) -> Result:
        """DO_CHANGE_ALTITUDE to metres above mean sea level; only in AUTO.LOITER."""
        if self.mode is not Mode.LOITER or not math.isfinite(altitude):
            return Result.TEMPORARILY_REJECTED
        at = self.flight.target or self.motion.position
        up = altitude - self.chart.origin.alt
        if self.flight.airborne:
            self.flight.begin(self.going(Vector(at.north, at.east, up), self.motion.heading))
        return Result.ACCEPTED

    def orbit(self, circle: Circle) -> Result:
        """DO_ORBIT"""
        if not self.flight.airborne:
            return Result.TEMPORARILY_REJECTED
        self.set_mode(Mode.ORBIT)
        self.flight.begin(circle)
        return Result.ACCEPTED

    def guide(self, setpoint: Task) -> None:
        """Take a setpoint; it is followed in OFFBOARD, now or later."""
        self.setpoint, self.setpoint_at = setpoint, self.now
        if self.mode is Mode.OFFBOARD:
            if isinstance(setpoint, GoTo) and isinstance(self.flight.task, GoTo):
                setpoint.length = self.flight.task.length
                self.flight.task = setpoint
            else:
                self.flight.begin(setpoint)

    def _guard(self, dt: float) -> None:
        self.failsafes.check(dt)
        self.navigator.report()
        self.outputs.look(armed=self.armed, airborne=self.flight.airborne)
        if not self.armed:
            self.battery.rest(dt, at_home=self.motion.position.distance(self.home_on_chart) <= 5.0)
        yields = self.mode.automatic or self.mode in (Mode.OFFBOARD, Mode.ORBIT)
        if self.sticks.alive(self.now) and self.flight.airborne:
            if self.sticks.override(self.parameters["MAN_OVERRIDE_SPD"]) and yields:
                self.send_text("Pilot took over using sticks")
                self.set_mode(Mode.POSCTL)
            if self.mode.piloted:
                self.flight.begin(self.sticks.drift(self.motion, self.now))

    lands_by_mission = False
    """Whether AUTO.RTL flies the landing of the mission."""
    takes_off: ClassVar[bool] = True
    """Whether NAV_TAKEOFF is taken."""
    has_airspeed: ClassVar[bool] = False

    @property
    def stream_limits(self) -> Limits | None:
        """Limits of the way to a place that is streamed in OFFBOARD; None: those of legs."""
        return None

    @property
    def circle(self) -> Circle | None:
        """The circle that it flies."""
        task = self.flight.task
        return task if isinstance(task, Circle) else None

    def _move(self, dt: float) -> None:
        flight, was = self.flight, self.flight.landed
        if flight.lift_at is not None and self.now >= flight.lift_at - self.DETECTED_S and not self.flown:
            self.flown, flight.landed = True, Landed.TAKEOFF
            self.set_home(self.place)
            self.send_text("Takeoff detected")
        flight.step(dt)
        if self.armed:
            self.battery.step(dt)
            if self.battery.empty:
                self.disarm("an empty battery", force=True)
        if flight.landed is Landed.ON_GROUND and was is not Landed.ON_GROUND:
            self.touched_down()
        if self.armed and flight.airborne:
            self._follow()
        elif self.armed:
            self._idle()

    def touched_down(self) -> None:
        """Take note of a landing."""
        self.landed_at = self.now
        self.send_text("Landing detected")
        if self.mode is Mode.MISSION:
            self.navigator.landed()

    skips_takeoff: ClassVar[bool] = False
    """Whether a takeoff item is passed over in the air."""
    climbs_first: ClassVar[bool] = True
    """Whether it reports to what height it climbs for a takeoff item."""
    altitude_acceptance: ClassVar[float] = 0.0
    """Metres beside the altitude of an item at which it is reached, at least."""

    def landing_problem(self, items: list[Item]) -> tuple[int, int] | None:
        """Return why the landing of a mission cannot be flown: an EVENT; None: it can."""
        return None

    def near(self, goal: Vector) -> bool:
        """Return whether it is near enough to a goal to fly on."""
        return self.motion.position.distance(goal) <= self.parameters["NAV_ACC_RAD"]

    def loiter_to_altitude_done(self, goal: Vector) -> bool:
        """Return whether it may leave a LOITER_TO_ALT at a goal."""
        return self.near(goal) and abs(goal.up - self.motion.up.position) < 1.0

    def mission_task(self, item: Item, goal: Vector) -> Task:
        """Return how an item of the mission is flown."""
        if item.command == missions.LAND:
            return Return(goal, Stage.CRUISE, Vector(goal.north, goal.east, max(2.0, self.motion.up.position)))
        return self.going(goal)

    def _follow(self) -> None:
        flight = self.flight
        if self.mode is Mode.TAKEOFF and flight.reached and isinstance(flight.task, TakeOff):
            flight.landed = Landed.IN_AIR
            self.settle_in(Mode.LOITER, self.after_takeoff(flight.task))
        elif self.mode is Mode.MISSION:
            self.navigator.follow()
        elif self._returning and isinstance(flight.task, Return) and flight.task.stage is Stage.DESCEND:
            self._returning = False
            self.send_text("RTL: land at destination")

    def after_takeoff(self, task: TakeOff) -> Task:
        """Return what it does when a takeoff has ended."""
        here = self.motion.position
        return self.going(Vector(here.north, here.east, task.up), self.motion.heading)

    def _idle(self) -> None:
        if self.flown and self.flight.landed is Landed.TAKEOFF and self.flight.lift_at is None:
            self.flown, self.flight.landed = False, Landed.ON_GROUND  # another mode ended the takeoff on the ground
        if self.flown and self.flight.landed is Landed.ON_GROUND:
            delay = self.parameters["COM_DISARM_LAND"]
            if delay > 0 and self.now - self.landed_at >= delay:
                self.disarm("landing")
        elif not self.flown and self.flight.lift_at is None:
            delay = self.parameters["COM_DISARM_PRFLT"]
            if delay > 0 and self.now - self.armed_at >= delay + PREFLIGHT_EXTRA_S:
                self.disarm("auto preflight disarming")
