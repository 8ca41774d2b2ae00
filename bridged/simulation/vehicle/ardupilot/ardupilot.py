"""What ArduPilot's copters, planes and rovers have in common, without MAVLink: checks, modes, missions, failsafes."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, Self

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.ardupilot.battery import Battery
from bridged.simulation.vehicle.ardupilot.boot import FIRST_HEARTBEAT_S, Boot, Milestone, Script
from bridged.simulation.vehicle.ardupilot.failsafes import Fence, StationLink, StationWatch, check_failsafes
from bridged.simulation.vehicle.ardupilot.mission import DO_COMMANDS, NAV_COMMANDS, Mission, do
from bridged.simulation.vehicle.ardupilot.rc_input import Transmitter
from bridged.simulation.vehicle.ardupilot.servo_outputs import Outputs
from bridged.simulation.vehicle.autopilot import Autopilot
from bridged.simulation.vehicle.mission_items import Item
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.motion.tasks import Drift, GoTo, Stop, Task
from bridged.simulation.vehicle.notifications import ItemReached, ModeChanged, ParameterChanged, Result, Severity
from bridged.simulation.vehicle.payload import Payload

UNASKED_S = dict.fromkeys((0, 1, 2, 24, 30, 32, 33, 36, 42, 62, 65, 74, 87, 125, 147, 152, 193, 241), 1.0)
"""Intervals of the streams that come unasked from the recorded plane and rover, by message id."""
HOME_FOLLOWS_S, _MOVED = 1.0, 0.2
"""Period in seconds in which home follows a disarmed vehicle, and metres that it must have moved."""
Texts = Sequence[tuple[str, Severity]]


class ArduPilot(Autopilot):
    """One vehicle with ArduPilot."""

    SYSTEM_ID: ClassVar = "MAV_SYSID"
    FIRST_HEARTBEAT_S: ClassVar = FIRST_HEARTBEAT_S
    CAPABILITIES: ClassVar[int] = 1 | 2 | 4 | 8 | 128 | 256 | 8192
    """capabilities of AUTOPILOT_VERSION"""
    VTOL_STATE: ClassVar[int] = 0
    """vtol_state of EXTENDED_SYS_STATE (MAV_VTOL_STATE)."""
    SCRIPT: ClassVar[Script]
    """Its boot sequence."""
    DEFAULTS_S: ClassVar[dict[int, float]] = {0: 1.0}
    """Intervals of the streams that come unasked, by message id."""
    OUTSIDE_GUIDED: ClassVar[Result] = Result.DENIED
    """Result of a DO_REPOSITION that may not change the mode, in another one."""
    TAKES_SETPOINTS: ClassVar[bool] = True
    """Whether SET_POSITION_TARGET messages are taken in GUIDED; else they are ignored in silence."""
    DISARMS_UNDER_WAY: ClassVar[bool] = False
    """Whether its motors may be stopped under way without force."""
    REACHED: ClassVar[str] = "command"
    """How it calls a waypoint that it has reached."""
    HOME_FOLLOWS: ClassVar[bool] = False
    """Whether home follows it while it is disarmed."""
    STATION: ClassVar[tuple[str, str, float]] = ("FS_GCS_ENABLE", "FS_GCS_TIMEOUT", 0.0)
    """Of its GCS failsafe: see `StationWatch`."""
    MODES: ClassVar[Any]
    """The enumeration of the kind's modes: each has GUIDED, AUTO, RTL and LOITER."""
    INITIAL: ClassVar[Any]
    """The mode after power on."""
    SWITCHED: ClassVar[Any]
    """The mode that the pilot's switch sets at the end of the boot."""
    REPORTS: ClassVar[frozenset[Any]]
    """Modes in which POSITION_TARGET_GLOBAL_INT is sent."""
    mode: Any

    def _assemble(self, before: Self | None) -> None:
        self.boot = Boot(self.boot_kind, self.chart.origin.alt, self.SCRIPT)
        self.battery = Battery(self.parameters, self.charge_time)
        self.fence = Fence(self.parameters)
        self.station = StationWatch(self.parameters, *self.STATION)
        self.outputs = Outputs(self.parameters)
        self.outputs.on_move = lambda output, pulse: self.on_servo(output, pulse)
        self.payload = Payload()
        self.transmitter = Transmitter(self.parameters)
        self.mission: Mission = Mission() if before is None else before.mission
        self.mission.rewind()
        self.mode = self.INITIAL
        self._actions: list[Item] = []  # mission items to be done on the way
        self._actions_wait_until = 0.0
        self._arrived = False
        self._home_at = 0.0

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

    @property
    @abstractmethod
    def base_mode(self) -> int:
        """base_mode of HEARTBEAT."""

    @property
    @abstractmethod
    def system_status(self) -> int:
        """system_status of HEARTBEAT."""

    @property
    def landed_state(self) -> int:
        """landed_state of EXTENDED_SYS_STATE."""
        return int(self.flight.landed)

    @property
    def reports_target(self) -> bool:
        """Whether POSITION_TARGET_GLOBAL_INT is sent."""
        return self.mode in self.REPORTS

    def set_mode(self, number: int) -> Result:
        """Change the flight mode to that of a number (custom_mode); status texts give the reason of a refusal."""
        try:
            mode = self.MODES(number)
        except ValueError:
            self.send_text(f"No such mode {number}", Severity.WARNING)
            return Result.FAILED
        if mode is self.mode:
            return Result.ACCEPTED
        if refusal := self.refusal(mode):
            for text, severity in refusal:
                self.send_text(text, severity)
            return Result.FAILED
        self.take_mode(mode)
        self.enter(mode)
        return Result.ACCEPTED

    @abstractmethod
    def refusal(self, mode: Any) -> Texts:
        """Return the texts by which a flight mode is refused; none: it can be entered."""

    @abstractmethod
    def enter(self, mode: Any) -> None:
        """Begin what a flight mode does."""

    def pilot_sets(self, number: int) -> None:
        """Change the flight mode to that of a number, as a pilot at the field does by his switch."""
        self.set_mode(number)

    def take_mode(self, mode: Any) -> None:
        """Note another flight mode."""
        self.mode = mode
        self.flight.cruise_speed, self._arrived = None, False
        self.events.append(ModeChanged())

    @abstractmethod
    def arming_problems(self) -> list[str]:
        """Return the failed arming checks in the vehicle's words; none if the motors can be armed."""

    def arm(self, *, force: bool = False) -> Result:
        """Start the motors; texts give the reasons of a refusal."""
        if self.armed:
            return Result.ACCEPTED
        problems = self.arming_problems()
        if problems and not (force and self.passed(Milestone.READY)):
            for problem in problems:
                self.send_text(f"Arm: {problem}", Severity.CRITICAL)
            return Result.FAILED
        self.flight.arm()
        self.has_armed()
        return Result.ACCEPTED

    @abstractmethod
    def has_armed(self) -> None:
        """Do what is done when the motors have been started."""

    def disarm(self, *, force: bool = False) -> Result:
        """Stop the motors; refused in the air unless forced."""
        if not self.armed:
            return Result.ACCEPTED
        if self.flight.airborne and not (force or self.DISARMS_UNDER_WAY):
            return Result.FAILED
        self.flight.disarm()
        self.has_disarmed()
        return Result.ACCEPTED

    @abstractmethod
    def has_disarmed(self) -> None:
        """Do what is done when the motors have been stopped."""

    def take_off(self, altitude: float) -> Result:
        """MAV_CMD_NAV_TAKEOFF to metres above home."""
        return Result.UNSUPPORTED

    def land(self) -> Result:
        """MAV_CMD_NAV_LAND"""
        return Result.UNSUPPORTED

    def start_landing(self) -> Result:
        """MAV_CMD_DO_LAND_START"""
        return Result.UNSUPPORTED

    @property
    def setpoint_lasts(self) -> float:
        """Seconds after which a velocity that was sent once ends."""
        return max(0.1, self.parameters["GUID_TIMEOUT"])

    @abstractmethod
    def bring_home(self) -> None:
        """Do what failsafes do that bring it home."""

    @abstractmethod
    def on_station(self, change: StationLink) -> None:
        """Act when the ground station is lost, and when it is found again."""

    def on_position_lost(self) -> None:
        """Act when the estimator has no position any more."""

    def on_fence(self, action: int) -> None:
        """Act when the fence is breached, by FENCE_ACTION."""
        if action:
            self.bring_home()

    def on_shortage(self, action: int) -> None:
        """Act when the battery is low, by the BATT_FS_ parameters."""
        self.bring_home()

    def allows(self, goal: Vector) -> bool:
        """Return whether the fence allows a goal."""
        return self.fence.breach(goal, self.home_on_chart) is None

    def guide(self, task: GoTo | Drift) -> bool:
        """Follow a goal or a velocity; returns False if it is dropped: not in GUIDED, or outside the fence."""
        self._arrived = False
        if self.mode is not self.MODES.GUIDED or (isinstance(task, GoTo) and not self.allows(task.goal)):
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
        check_failsafes(self, dt)
        if self.HOME_FOLLOWS and not self.armed and self.home is not None and self.now >= self._home_at:
            self._home_at = self.now + HOME_FOLLOWS_S
            if self.motion.position.distance(self.home_on_chart) > _MOVED:
                self.set_home(self.place)

    @property
    def effort(self) -> float:
        """Current that the motors draw in the air, in multiples of that of a hover."""
        return 1.0

    def _fly(self, dt: float) -> None:
        """Let flight and battery pass `dt` seconds."""
        flight, was_airborne = self.flight, self.flight.airborne
        flight.step(dt)
        self.battery.step(dt, flying=flight.airborne and flight.armed, effort=self.effort)
        if flight.armed and self.battery.empty:
            flight.disarm()
            self.send_text("SIM battery is empty", Severity.CRITICAL)
        if was_airborne and not flight.airborne:
            self.send_text(f"SIM Hit ground at {flight.touchdown_speed:f} m/s")

    def _reach(self, milestone: Milestone | None, texts: Texts) -> None:
        if milestone is Milestone.READY and self.SWITCHED is not self.INITIAL:
            self.take_mode(self.SWITCHED)
        if milestone is Milestone.HOME:
            self.set_home(self.place)
            self.count_mission(len(self.mission.items) + 1)
        for text, severity in texts:
            self.send_text(text, severity)
        if milestone is Milestone.MODE_SWITCH and self.mode is not self.SWITCHED and not self.armed:
            self.set_mode(self.SWITCHED)

    def count_mission(self, total: int) -> None:
        """Set MIS_TOTAL to the number of stored items, home included."""
        if self.parameters.set("MIS_TOTAL", total):
            self.events.append(ParameterChanged("MIS_TOTAL"))

    @abstractmethod
    def start_mission(self) -> Result:
        """MAV_CMD_MISSION_START"""

    def jump_to(self, seq: int) -> bool:
        """MISSION_SET_CURRENT: AUTO continues, or will begin, with item `seq` (from 1). Returns False without one."""
        if self.mission.item(seq) is None:
            return False
        self.mission.complete = False
        if self.mode is self.MODES.AUTO:
            self._fly_from(seq)
        else:
            self.mission.current = seq
        return True

    def _fly_on(self) -> None:
        """Fly the mission from its current item; one that is over from its first."""
        first = 1 if self.mission.complete else max(1, self.mission.current)
        self.mission.complete = False
        self._fly_from(first)

    def _fly_from(self, seq: int) -> None:
        """Fly to the next place of the mission; DO commands before it run on the way."""
        between, item = self.mission.next_place(seq)
        self._actions = [action for action in between if action.command in DO_COMMANDS]
        self._actions_wait_until = self.now
        if item is None:
            self.mission.complete = True
            self.mission_ended()
            return
        self.mission.start(item, self.now)
        self.send_text(f"Mission: {item.seq} {NAV_COMMANDS[item.command]}")
        if self.flight.airborne:
            self._begin_item(item)
        else:
            self.flight.begin(Stop())  # on the ground AUTO waits for MISSION_START

    def _begin_item(self, item: Item | None) -> None:
        self.flight.begin(Stop() if item is None else self.task_of(item))

    @abstractmethod
    def task_of(self, item: Item) -> Task:
        """Return the effect of an item of the mission."""

    def mission_ended(self) -> None:
        """Do what is done after the last item."""
        self.flight.begin(Stop())

    def _follow_mission(self) -> None:
        if self._actions and self.now >= self._actions_wait_until:
            self._do(self._actions.pop(0))
        item = self.mission.item(self.mission.current)
        if item is None or self.mission.complete or not self.flight.airborne:
            return
        if self.mission.done(item, self.flight, self.now):
            self.item_reached(item)
            self._fly_from(item.seq + 1)

    def item_reached(self, item: Item) -> None:
        """Report that an item is done."""
        self.events.append(ItemReached(item.seq))
        if NAV_COMMANDS[item.command] == "WP":
            self.send_text(f"Reached {self.REACHED} #{item.seq}")

    def _do(self, item: Item) -> None:
        self.send_text(f"Mission: {item.seq} {DO_COMMANDS[item.command]}")
        if item.command == dialect.MAV_CMD_CONDITION_DELAY:
            self._actions_wait_until = self.now + item.params[0]
        else:
            do(self, item.command, item.params)
        self.events.append(ItemReached(item.seq))
