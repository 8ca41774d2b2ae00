"""Context of a procedure: the vehicle's state, the means to act on it, and the limits of its waits."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Generator, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Execution, FinalState, Outcome, Reading, Value
from bridged.drivers.mavlink.actions.mission_items import Item
from bridged.drivers.mavlink.vehicle.commands import Commands, MavlinkCommand, Parameters
from bridged.drivers.mavlink.vehicle.flight_modes import ModeTable
from bridged.drivers.mavlink.vehicle.state import GOES_DOWN, Place, Vehicle
from bridged.drivers.mavlink.vehicle.status_texts import Texts
from commd.process.state_dir import make_private_folder, replace_file
from schemas.manifest.loader import Retry
from schemas.mission.model import Failsafe, Limits
from schemas.wire.records import Cause

if TYPE_CHECKING:
    from bridged.drivers.mavlink.autopilots.autopilot import Autopilot, VelocityStream

Steps = Generator[None, None, Outcome]
"""Steps of a procedure: it reads the flight's state, yields until a change, and returns its outcome."""
Part = Generator[None, None, None]
"""A part of a procedure: raises `Ended` where the procedure ends without success by it."""

TEXT_WINDOW = (1.0, 0.3)
"""Mission and wall seconds around an acknowledgement in which the vehicle's texts belong to it."""
EXPECTED_FOR = (5.0, 2.0)
"""Mission and wall seconds for which a mode that we asked for may still appear."""
PRESENT_FOR = (5.0, 3.0)
"""Mission and wall seconds since it was heard last for which a camera or gimbal counts as there; a HEARTBEAT comes
each second."""
POSITION_ONLY = 0b110111111000
"""Type mask of a position target: velocity, acceleration, yaw and yaw rate ignored."""
POSITION_IGNORED, VELOCITY_IGNORED, YAW_IGNORED, YAW_RATE_IGNORED = 0b111, 0b111000, 1 << 10, 1 << 11
ALL_IGNORED = 0b110111111111
"""Parts of a type mask (POSITION_TARGET_TYPEMASK); a force is not meant."""

MARGIN = 2.0
"""Metres beyond a limit that are no excursion: arriving at the limit itself overshoots a little."""
GUIDED_TIMEOUT = 3.0
"""Seconds after which a vehicle that is given no new velocity stops (ArduPilot's GUID_TIMEOUT)."""
MAX_PARAMETERS = 256
"""Parameters whose values are kept up to date; the oldest is forgotten."""

UNKNOWN_MISSION = "what mission the vehicle holds now is not known; upload again or clear it"

Triple = tuple[float, float, float]
SUCCEEDED = Outcome("succeeded")
log = logging.getLogger("mavlink")


class Ended(Exception):
    """A procedure has ended in one of its parts, refused or failed."""

    def __init__(self, state: FinalState, reason: str, cause: Cause = "driver") -> None:
        super().__init__(reason)
        self.outcome = Outcome(state, reason, cause)


NOBODYS_FAILSAFE = Failsafe()


@dataclass(frozen=True, slots=True)
class Files:
    """The files of a robot's procedures."""

    robot: str = ""
    mission: Path = Path()
    """Folder of the mission file: plan files are read there and below."""
    logs: Path = Path()
    """Folder for logs that are downloaded from the vehicle."""


NO_FILES = Files()


@dataclass(frozen=True, slots=True)
class LocalTarget:
    """A target of SET_POSITION_TARGET_LOCAL_NED: a place or a velocity, north-east-down or forward-right-down."""

    frame: int
    position: Triple | None = None
    """Metres from the estimator's origin."""
    velocity: Triple | None = None
    """m/s."""
    yaw: float | None = None
    """Radians from north, clockwise."""
    yaw_rate: float | None = None
    """rad/s, clockwise."""


@dataclass(frozen=True, slots=True)
class BoundAction:
    """An action of the manifest with its arguments filled in."""

    number: int = 0
    parameters: Parameters = (0.0,) * 7
    retry: Retry = field(default_factory=Retry)
    mode: int = -1
    """The mode that the command enters, as HEARTBEAT.custom_mode shows it; -1 = none."""
    target: Place | None = None
    frame: int = dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
    yaw: float | None = None
    """Radians from north, clockwise; none = as the vehicle likes."""
    local: LocalTarget | None = None
    channels: tuple[int, ...] = ()
    """Values of RC_CHANNELS_OVERRIDE."""
    by_int: bool = False
    """The command goes as COMMAND_INT, its place in `frame`."""
    component: int = 0
    """The component of the vehicle's system that the command is for; 0 = the autopilot."""
    tolerance: float | None = None
    limited: bool = True
    """The mission's limits hold; not for what brings a vehicle to a stop where it is."""
    arguments: Mapping[str, Value] = field(default_factory=dict)
    """Arguments of a `call` of the driver."""


def mode_action(modes: ModeTable, mode: int) -> BoundAction:
    """Return DO_SET_MODE to a mode of the vehicle, by its number (custom_mode)."""
    parameters = (float(dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED), *modes.request(mode), 0.0, 0.0, 0.0, 0.0)
    return BoundAction(dialect.MAV_CMD_DO_SET_MODE, parameters, mode=mode)


@dataclass(frozen=True)
class Procedure:
    """How a kind of action or order is carried out, once its arguments are filled in."""

    make_steps: Callable[[ProcedureContext, ProcedureRun, BoundAction], Steps]
    feedback: tuple[str, ...] = ()
    """The figures of its progress."""
    sets_mode: bool = False
    """Changes of the mode are its own business."""
    takes_control: bool = False
    """Its success ends an override by others."""
    judges_mode: bool = False
    """It sets the mode and knows by itself which changes end it: a mission that is over leaves AUTO."""


@dataclass(eq=False, kw_only=True)
class ProcedureRun(Execution):
    """A procedure that runs for one action or order."""

    procedure: Procedure
    action: BoundAction
    steps: Steps = field(init=False)
    bind: Callable[[], BoundAction] | None = None
    """Binds the action again, for a vehicle that was not heard when it began: its autopilot decides what is sent."""
    moves: bool = True
    """A mode that nobody here asked for ends it."""
    yields: bool = False
    """It insists on nothing, as the bridge's own orders and a pause: a mode that others set ends it."""
    judges_mode: bool = False
    """It knows by itself which changes of the mode end it: its procedure does, or this run of it."""
    by_agent: bool = False
    """An agent wished it: what it moves, or sets the mode of, is in the agent's control."""
    trouble: str = ""
    """The obstacle to its end, for people: a warning of health."""
    leaves: str = ""
    """Unfinished effects if it ended now, for people."""
    commands: list[MavlinkCommand] = field(default_factory=list)
    """Its commands so far: withdrawn when it ends early."""


class Plan:
    """Known facts of the mission that the vehicle stores."""

    def __init__(self, file: Path | None = None) -> None:
        """`file` exists while `broken` is not empty: a bridge that is killed during an upload must not forget it."""
        self.items: tuple[Item, ...] | None = None
        """As it was sent or read last; none = not known. The first is home."""
        self.busy = ""
        """The action that is speaking the mission protocol now: the vehicle speaks it with one at a time."""
        self.flown_by = ""
        """The action that is flying the mission now."""
        self.sent_to = 0
        """The item that an action made the current one last."""
        self._file, self._broken = file, ""
        try:
            self._broken = "" if file is None else file.read_text(errors="replace")
        except FileNotFoundError:
            pass
        except OSError as error:
            self._broken = f"{file} cannot be read ({error.strerror}): {UNKNOWN_MISSION}"

    @property
    def broken(self) -> str:
        """Remains of an interrupted upload, for people, also of one that a former run of the bridge began.

        Setting it raises Ended if that cannot be kept on disk: no upload begins then.
        """
        return self._broken

    @broken.setter
    def broken(self, text: str) -> None:
        if self._file is not None and bool(text) != bool(self._broken):
            try:
                if text:
                    make_private_folder(self._file.parent)
                    replace_file(self._file, text.encode())
                else:
                    self._file.unlink(missing_ok=True)
            except OSError as error:
                if text:
                    raise Ended("refused", f"{self._file} cannot be written: {error.strerror}") from error
                log.error("%s cannot be removed: %s", self._file, error.strerror)
        self._broken = text


class ProcedureContext:
    """One vehicle, as the procedures see it. `now` is in mission seconds and moves with each message and tick."""

    def __init__(
        self,
        vehicle: Vehicle,
        autopilot: Autopilot,
        commands: Commands,
        texts: Texts,
        send: Callable[[dialect.MAVLink_message], None],
        speed: float,
        limits: Limits,
        report: Callable[[Reading], None] = lambda reading: None,
        failsafe: Failsafe = NOBODYS_FAILSAFE,
    ) -> None:
        self.vehicle = vehicle
        self.autopilot = autopilot
        """As the vehicle's HEARTBEAT names it."""
        self.velocity: VelocityStream | None = None
        """The velocity that is being streamed."""
        self.commands = commands
        self.addressee = commands.identity.addressee
        """System and component of the vehicle's autopilot, the target of messages."""
        self.autopilot_component = commands.identity.autopilot
        self.texts = texts
        self.limits = limits
        self.outside = ""
        """Which limit of the mission is broken now, for people; empty = none."""
        self.failsafe = failsafe
        self.now = 0.0
        self.asked_last = -1
        """The mode that we asked for last: one that it takes on while it cannot be heard is nobody else's."""
        self.message: dialect.MAVLink_message | None = None
        """The present message of the vehicle; None while only time passes."""
        self.report = report
        """Takes readings of the driver's own sources."""
        self.interrupted: list[BoundAction] = []
        """Actions that the last pause has interrupted: a takeoff among them continues in the air."""
        self.files = NO_FILES
        self.plan = Plan()
        self.pictures = 0
        """The number of the last picture that a camera was commanded to take."""
        self.connected_since = -math.inf
        """When the vehicle was heard after a silence, last."""
        self.downloading = ""
        """The action that is downloading a log now: the vehicle sends one at a time."""
        self.parameters: dict[str, float] = {}
        """Those that were asked for, under the name that was asked for."""
        self.send = send
        self._speed = speed
        self._expected: dict[int, float] = {}

    def present(self, components: Iterable[int]) -> list[int]:
        """Return the cameras or gimbals, by component id, that have been heard lately."""
        since = self.now - self.wait(*PRESENT_FOR)
        return [one for one in components if self.vehicle.payload_heard_at[one] >= since]

    def goes_on(self, action: BoundAction) -> bool:
        """Whether the last pause has interrupted this action, and it is begun again for the first time."""
        interrupted = action in self.interrupted
        self.interrupted = []
        return interrupted

    def wait(self, mission: float, wall: float) -> float:
        """Mission seconds that last at least `mission` on the vehicle's clock and `wall` on ours (design section 8)."""
        return max(mission, wall * self._speed)

    def to_wall(self, mission: float) -> float:
        """Return the wall seconds that a span of mission seconds takes."""
        return mission / self._speed

    def submit(
        self,
        run: ProcedureRun,
        action: BoundAction,
        may_repeat: Callable[[], bool] = lambda: True,
        *,
        in_frame: bool = False,
    ) -> MavlinkCommand:
        """Send the command of an action; `in_frame`: as COMMAND_INT if the action names the frame of its place.

        One that is no order is repeated only at a HEARTBEAT: a pilot may have the vehicle who is not seen yet.
        """
        frame = action.frame if in_frame and action.by_int else None
        command = MavlinkCommand(
            action.number, action.parameters, action.retry, may_repeat, frame=frame, component=action.component
        )
        if not action.component and (run.moves or run.by_agent or run.yields):
            command.seen_at = lambda: self.vehicle.heard_at
        run.commands.append(command)
        return self.commands.submit(command, self.now)

    def send_target(self, place: Place, frame: int, yaw: float | None = None) -> None:
        """Send a position target; nothing acknowledges it. `frame`: MAV_FRAME; `yaw`: radians from north, clockwise."""
        latitude, longitude = round(place.latitude * 1e7), round(place.longitude * 1e7)
        mask = POSITION_ONLY if yaw is None else POSITION_ONLY & ~YAW_IGNORED
        self.send(
            dialect.MAVLink_set_position_target_global_int_message(
                0,
                *self.addressee,
                frame,
                mask,
                latitude,
                longitude,
                place.altitude,
                *(0.0,) * 6,
                yaw or 0.0,
                0.0,
            )
        )

    def send_local(self, target: LocalTarget) -> None:
        """Send a target in metres or m/s; nothing acknowledges it."""
        mask = ALL_IGNORED
        for value, ignored in (
            (target.position, POSITION_IGNORED),
            (target.velocity, VELOCITY_IGNORED),
            (target.yaw, YAW_IGNORED),
            (target.yaw_rate, YAW_RATE_IGNORED),
        ):
            if value is not None:
                mask &= ~ignored
        self.send(
            dialect.MAVLink_set_position_target_local_ned_message(
                0,
                *self.addressee,
                target.frame,
                mask,
                *(target.position or (0.0,) * 3),
                *(target.velocity or (0.0,) * 3),
                *(0.0,) * 3,
                target.yaw or 0.0,
                target.yaw_rate or 0.0,
            )
        )

    def learn(self, asked: str, value: float) -> None:
        """Keep a parameter's value and report it, under the requested name."""
        if asked not in self.parameters and len(self.parameters) >= MAX_PARAMETERS:
            self.parameters.pop(next(iter(self.parameters)))
        self.parameters[asked] = value
        self.report(Reading("PARAM", {"name": asked, "value": value}))

    def expect_mode(self, mode: int) -> None:
        """Count `mode` as requested by us for a while: a pilot's change must be distinguished from ours."""
        self.asked_last = mode
        self._expected = {known: until for known, until in self._expected.items() if until >= self.now}
        self._expected[mode] = self.now + self.wait(*EXPECTED_FOR)

    def entered(self, mode: int) -> None:
        """Expect no more those modes that were requested before one that the vehicle has entered."""
        asked = self._expected.get(mode, -math.inf)
        self._expected = {known: until for known, until in self._expected.items() if until >= asked}

    def expect_none(self) -> None:
        """Count no mode as requested by us: others have set one since."""
        self.asked_last, self._expected = -1, {}

    def expects(self, mode: int) -> bool:
        """Whether we asked for the mode of this number (custom_mode) lately."""
        return self._expected.get(mode, -1.0) >= self.now

    @property
    def limited(self) -> bool:
        """Whether the mission file sets limits."""
        return self.limits.altitude is not None or self.limits.radius is not None

    def altitude_of_home(self) -> float | None:
        """Metres AMSL of home, None if not known."""
        vehicle = self.vehicle
        if vehicle.position is not None:
            return vehicle.amsl - vehicle.position.altitude
        return vehicle.home.altitude if vehicle.home is not None else None

    def outside_limits(self, place: Place, around: float = 0.0) -> str:
        """Return which limit of the mission a point (metres above home) breaks, for people; empty = none.

        `around`: metres around it that count too.
        """
        return self.too_high(place.altitude) or self.too_far(place, around)

    def too_high(self, altitude: float) -> str:
        """Return that metres above home exceed the mission's limit, for people; empty = they do not."""
        limit = self.limits.altitude
        if limit is None or altitude <= limit:
            return ""
        return f"altitude {altitude:g} m is above the mission's limit of {limit:g} m"

    def too_far(self, place: Place, around: float = 0.0) -> str:
        """Return that a point is farther from home than the mission's limit, for people; empty = it is not."""
        limit, home = self.limits.radius, self.vehicle.home
        if limit is None:
            return ""
        if home is None:
            return "home is not known, so the mission's radius limit cannot be kept"
        distance = home.distance(place) + around
        return f"{distance:.0f} m from home is outside the mission's limit of {limit:g} m" if distance > limit else ""

    def leads_outside(self, velocity: Triple) -> str:
        """Return which limit a velocity (m/s north, east, down) breaks before the vehicle stops by itself."""
        here = self.vehicle.position
        if here is None:
            return "the vehicle's position is not known yet" if self.limited else ""
        if self.limited and not self.vehicle.placed:
            return "the vehicle has not reported its position lately, so the mission's limits cannot be kept"
        north, east, down = (speed * GUIDED_TIMEOUT for speed in velocity)
        there = here.moved(north, east, -down)
        broken = self.outside_limits(there)
        if broken and self.outside_limits(here):  # the way back must stay open
            home = self.vehicle.home
            nearer = home is None or home.distance(there) <= home.distance(here)
            if nearer and there.altitude <= here.altitude:
                return ""
        return f"in {GUIDED_TIMEOUT:g} s at that velocity: {broken}" if broken else ""

    def left_limits(self) -> str:
        """Return which limit of the mission was just left; empty if none was, or if others or RTL fly the vehicle."""
        limits, vehicle, modes = self.limits, self.vehicle, self.vehicle.modes
        if vehicle.overridden:
            return ""
        before, beyond, broken = self.outside, -math.inf, ""
        if vehicle.position is not None and limits.altitude is not None:
            beyond = vehicle.position.altitude - limits.altitude
            if beyond > MARGIN:
                broken = f"{vehicle.position.altitude:.1f} m above home, the limit is {limits.altitude:g} m"
        if vehicle.position is not None and limits.radius is not None and vehicle.home is not None:
            away = vehicle.home.distance(vehicle.position)
            beyond = max(beyond, away - limits.radius)
            if not broken and away - limits.radius > MARGIN:
                broken = f"{away:.0f} m from home, the limit is {limits.radius:g} m"
        if broken or beyond <= 0.0:
            self.outside = broken
        if not broken or before or not vehicle.aloft or vehicle.mode not in (*modes.targets, modes.auto):
            return ""
        leaving = self.expects(modes.rtl) or self.expects(modes.land)
        return "" if leaving else f"the vehicle left the mission's limits: {broken}"

    def with_texts(self, reason: str, since: float) -> str:
        """Return a reason with the vehicle's texts since then, or with its state if there were none."""
        texts = self._texts_since(since)
        return f"{reason}: {texts}" if texts else f"{reason}; {self.state_text()}"

    def refusal(self, command: MavlinkCommand, since: float) -> str:
        """Return why the vehicle refused a command, with its texts since then.

        The state of a vehicle explains a refusal, and not that it does not have the command.
        """
        reason = f"the vehicle refused {command.name} ({command.result_name})"
        if command.result != dialect.MAV_RESULT_UNSUPPORTED:
            return self.with_texts(reason, since)
        texts = self._texts_since(since)
        return f"{reason}: it does not support this command" + (f"; {texts}" if texts else "")

    def _texts_since(self, since: float) -> str:
        return self.texts.since(since - self.wait(*TEXT_WINDOW))

    @property
    def others(self) -> str:
        """Who set a mode that nobody here asked for, for people."""
        if not self.vehicle.failsafe_acts:
            return "pilot, ground station or failsafe"
        state = dialect.enums["MAV_STATE"][self.vehicle.system_status].name.removeprefix("MAV_STATE_")
        return f"the vehicle's failsafe{f'; its state is {state}' if self.vehicle.system_status in GOES_DOWN else ''}"

    def state_text(self) -> str:
        """Return mode, arming and whether it flies, for people."""
        vehicle = self.vehicle
        if not vehicle.connected:
            return "the vehicle is not connected"
        armed = "armed" if vehicle.armed else "not armed"
        where = "" if vehicle.modes.ground else " in flight," if vehicle.aloft else " on the ground,"
        return f"the vehicle is {armed},{where} in {vehicle.mode_name}"
