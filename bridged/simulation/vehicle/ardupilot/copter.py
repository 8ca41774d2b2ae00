"""The simulated copter without MAVLink: state, arming checks, modes, missions, failsafes."""

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.ardupilot.battery import Battery
from bridged.simulation.vehicle.ardupilot.boot import FIRST_HEARTBEAT_S, Boot, Milestone
from bridged.simulation.vehicle.ardupilot.copter_tuning import TOUCHDOWN_TO_DISARM_S, CopterTuning
from bridged.simulation.vehicle.ardupilot.failsafes import Fence, StationWatch, watch_over
from bridged.simulation.vehicle.ardupilot.flight_modes import Mode
from bridged.simulation.vehicle.ardupilot.mission import DO_COMMANDS, NAV_COMMANDS, Mission, do, task_of
from bridged.simulation.vehicle.ardupilot.parameters import Parameters
from bridged.simulation.vehicle.ardupilot.rc_input import Transmitter
from bridged.simulation.vehicle.ardupilot.servo_outputs import Outputs
from bridged.simulation.vehicle.autopilot import CHARGE_S, Autopilot, BootKind
from bridged.simulation.vehicle.geodesy import Place
from bridged.simulation.vehicle.mission_items import Item
from bridged.simulation.vehicle.motion.copter_flight import Flight
from bridged.simulation.vehicle.motion.dynamics import Motion, Vector
from bridged.simulation.vehicle.motion.tasks import Drift, GoTo, Land, Return, Stop, TakeOff, Task
from bridged.simulation.vehicle.notifications import (
    ItemReached,
    ModeChanged,
    ParameterChanged,
    Result,
    Severity,
)
from bridged.simulation.vehicle.payload import Payload

_YAW_ALIGNMENT_HEIGHT = 1.9
"""m above the ground at which the compass is checked in flight (recorded text)."""


class Copter(Autopilot):
    """An ArduCopter."""

    PILOTED = Mode.LOITER
    LANDING = Mode.LAND
    mode: Mode
    flight: Flight

    def __init__(
        self,
        start: Place,
        *,
        heading: float = 0.0,
        boot: BootKind = "quick",
        parameters: Parameters | None = None,
        stored: Mission | None = None,
        charge_time: float = CHARGE_S,
    ) -> None:
        """`parameters` and the `stored` mission are what is in the vehicle's memory from before a restart; at home an
        empty battery is full after `charge_time` seconds."""
        super().__init__(start, Motion(heading), FIRST_HEARTBEAT_S)
        self.parameters = parameters or Parameters()
        self.boot = Boot(boot, start.alt)
        self.flight = Flight(self.motion, CopterTuning(self.parameters))
        self.battery = Battery(self.parameters, charge_time)
        self.fence = Fence(self.parameters)
        self.station = StationWatch(self.parameters)
        self.outputs = Outputs(self.parameters)
        self.outputs.on_move = lambda output, pulse: self.on_servo(output, pulse)
        self.payload = Payload()
        self.transmitter = Transmitter(self.parameters)
        self.mission = stored or Mission()
        self.mode = Mode.STABILIZE
        self._compass_checked = False
        self._actions: list[Item] = []  # mission items to be done on the way
        self._actions_wait_until = 0.0

    def restarted(self, place: Place) -> "Copter":
        """Return the copter after a restart at a place on the ground."""
        self.mission.rewind()
        return Copter(
            place,
            heading=self.motion.heading,
            boot=self.boot.kind,
            parameters=self.parameters,
            stored=self.mission,
            charge_time=self.battery.charge_time,
        )

    @property
    def booting(self) -> bool:
        """Whether the boot sequence goes on."""
        return not self.boot.complete

    @property
    def has_position(self) -> bool:
        """Whether the estimator has a position."""
        return self.passed(Milestone.POSITION) and not self.estimate.lost

    @property
    def has_fix(self) -> bool:
        """Whether the GPS has started."""
        return self.passed(Milestone.GPS_FIX)

    def passed(self, milestone: Milestone) -> bool:
        """Return whether the boot sequence has passed a milestone."""
        return self.boot.passed(milestone, self.now)

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
        self.mode = mode
        self.flight.cruise_speed = None
        self.events.append(ModeChanged())
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

    def pilot_sets(self, number: int) -> None:
        """Change the flight mode to that of a number, as a pilot at the field does by his switch."""
        self.set_mode(number)

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
        problems = self.arming_problems()
        if problems and not (force and self.passed(Milestone.READY)):
            for problem in problems:
                self.send_text(f"Arm: {problem}", Severity.CRITICAL)
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

    def allows(self, goal: Vector) -> bool:
        """Return whether the fence allows a goal."""
        return self.fence.breach(goal, self.home_on_chart) is None

    def guide(self, task: GoTo | Drift) -> bool:
        """Follow a goal or a velocity; returns False if it is dropped: not in GUIDED, or outside the fence."""
        if self.mode is not Mode.GUIDED or (isinstance(task, GoTo) and not self.allows(task.goal)):
            return False
        if isinstance(task, GoTo) and isinstance(self.flight.task, GoTo):
            self.flight.task, self.flight.reached = task, False
        else:
            self.flight.begin(task)
        return True

    def _boot(self) -> None:
        if not self.boot.complete:
            for milestone, texts in self.boot.advance(self.now):
                self._reach(milestone, texts)

    def _guard(self, dt: float) -> None:
        watch_over(self, dt)

    def _reach(self, milestone: Milestone, texts: tuple[str, ...]) -> None:
        if milestone is Milestone.HOME:
            self.set_home(self.place)
            self.count_mission(len(self.mission.items) + 1)
        for text in texts:
            self.send_text(text)
        if milestone is Milestone.MODE_SWITCH and self.mode is not Mode.STABILIZE and not self.armed:
            self.set_mode(Mode.STABILIZE)

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

    def count_mission(self, total: int) -> None:
        """Set MIS_TOTAL to the number of stored items, home included."""
        if self.parameters["MIS_TOTAL"] != total:
            self.parameters.set("MIS_TOTAL", total)
            self.events.append(ParameterChanged("MIS_TOTAL"))

    def start_mission(self) -> Result:
        """MAV_CMD_MISSION_START: AUTO from its first item."""
        if not self.mission.flyable:
            return Result.FAILED
        if self.mode is not Mode.AUTO:
            return self.set_mode(Mode.AUTO)
        if self.armed and not self.flight.airborne:
            self._begin_item(self.mission.item(self.mission.current))
        return Result.ACCEPTED

    def jump_to(self, seq: int) -> bool:
        """MISSION_SET_CURRENT: AUTO continues, or will begin, with item `seq` (from 1). Returns False without one."""
        if self.mission.item(seq) is None:
            return False
        self.mission.complete = False
        if self.mode is Mode.AUTO:
            self._fly_from(seq)
        else:
            self.mission.current = seq
        return True

    def _fly_from(self, seq: int) -> None:
        """Fly to the next place of the mission; DO commands before it run on the way."""
        self._actions, item = self.mission.next_place(seq)
        self._actions_wait_until = self.now
        if item is None:
            self.mission.complete = True
            self.flight.begin(Stop())  # AUTO hovers where the mission ends (ArduCopter)
            return
        self.mission.start(item, self.now)
        self.send_text(f"Mission: {item.seq} {NAV_COMMANDS[item.command]}")
        if self.flight.airborne:
            self._begin_item(item)
        else:
            self.flight.begin(Stop())  # on the ground AUTO waits for MISSION_START

    def _begin_item(self, item: Item | None) -> None:
        task: Task = Stop()
        if item is not None:
            task = task_of(item, self.flight, self.chart, self.home or self.chart.origin)
        self.flight.begin(task)

    def _follow_mission(self) -> None:
        if self._actions and self.now >= self._actions_wait_until:
            self._do(self._actions.pop(0))
        item = self.mission.item(self.mission.current)
        if item is None or self.mission.complete or not self.flight.airborne:
            return
        if self.mission.done(item, self.flight, self.now):
            self.events.append(ItemReached(item.seq))
            if NAV_COMMANDS[item.command] == "WP":
                self.send_text(f"Reached command #{item.seq}")
            self._fly_from(item.seq + 1)

    def _do(self, item: Item) -> None:
        self.send_text(f"Mission: {item.seq} {DO_COMMANDS[item.command]}")
        if item.command == dialect.MAV_CMD_CONDITION_DELAY:
            self._actions_wait_until = self.now + item.params[0]
        else:
            do(self, item.command, item.params)
        self.events.append(ItemReached(item.seq))
