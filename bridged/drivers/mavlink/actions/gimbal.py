"""Gimbals: pointed by the gimbal manager (MAVLink's gimbal protocol, version 2), confirmed by the gimbal's attitude.

The manager is the autopilot, or a gimbal that is a component of the vehicle's system. It obeys who is in control of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Outcome
from bridged.drivers.mavlink.actions.confirmation import ABOVE_HOME, Poll, acknowledged, comes_true, next_message
from bridged.drivers.mavlink.actions.context import (
    SUCCEEDED,
    BoundAction,
    Ended,
    ProcedureContext,
    ProcedureRun,
    Steps,
    Triple,
)
from bridged.drivers.mavlink.vehicle.state import ATTACHED, GIMBALS
from schemas.geo import EARTH_RADIUS

MANAGER_ANSWERS_WITHIN = (5.0, 3.0)
"""Mission and wall seconds in which a gimbal manager reports its state; PX4 does so each 2 s."""
POINTS_WITHIN = (20.0, 8.0)
"""Mission and wall seconds in which a gimbal must have turned; slow ones take 10 s for half a circle."""
NEAR = 3.0
"""Degrees between the directions within which it points there, unless the manifest says otherwise."""
UNIT_NEAR = 0.05
"""By how much the length of a quaternion may differ from 1."""
_LEAVE = -1.0
"""Parameter of DO_GIMBAL_MANAGER_CONFIGURE: unchanged."""

Direction = Callable[[], Triple | None]
"""The direction to point to, as a unit vector north, east, up; None while it is not known."""


def point(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """DO_GIMBAL_MANAGER_PITCHYAW: the gimbal's attitude shows the angles, over the horizon and from bow or north."""
    pitch, yaw, pitch_rate, yaw_rate, flags, spare, device = action.parameters
    if pitch_rate or yaw_rate:
        return Outcome("refused", "angles are confirmed by the gimbal, rates (param3, param4) are not")
    absolute = bool(int(flags) & dialect.GIMBAL_MANAGER_FLAGS_YAW_LOCK)
    manager = yield from control(flight, run, int(device))
    action = replace(action, parameters=(pitch, yaw, math.nan, math.nan, flags, spare, device))

    def wanted() -> Triple | None:
        heading = 0.0 if absolute else flight.vehicle.heading
        return None if heading is None else _vector(math.radians(pitch), math.radians(yaw) + heading)

    return (yield from _pointed(flight, run, action, manager, wanted))


def look_at(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """DO_SET_ROI_LOCATION: the gimbal's attitude shows the direction to the place, also as the vehicle moves."""
    target, home = action.target, flight.altitude_of_home()
    if target is None or (action.frame in ABOVE_HOME and home is None):
        return Outcome("refused", "the altitude of home, from which the place's altitude counts, is not known yet")
    altitude = target.altitude + ((home or 0.0) if action.frame in ABOVE_HOME else 0.0)
    manager = yield from control(flight, run, int(action.parameters[0]))
    parameters = (*action.parameters[:6], altitude)
    action = replace(action, parameters=parameters, frame=dialect.MAV_FRAME_GLOBAL, by_int=True)

    def wanted() -> Triple | None:
        here = flight.vehicle.position
        if here is None or not flight.vehicle.placed:
            return None
        north = math.radians(target.latitude - here.latitude) * EARTH_RADIUS
        east = math.radians(target.longitude - here.longitude) * EARTH_RADIUS * math.cos(math.radians(here.latitude))
        away = (north, east, altitude - flight.vehicle.amsl)
        length = math.hypot(*away)
        return (away[0] / length, away[1] / length, away[2] / length) if length else None

    return (yield from _pointed(flight, run, action, manager, wanted))


def look_nowhere(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """DO_SET_ROI_NONE: the manager acknowledges it; what the gimbal does then is its own."""
    manager = yield from control(flight, run, int(action.parameters[0]))
    command = flight.submit(run, replace(action, component=manager.addressee))
    yield from acknowledged(flight, run, command, lambda: False)
    return SUCCEEDED


STEPS = {
    dialect.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW: point,
    dialect.MAV_CMD_DO_SET_ROI_LOCATION: look_at,
    dialect.MAV_CMD_DO_SET_ROI_NONE: look_nowhere,
}
"""By command."""


def command_gimbal(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """Carry out a command to a gimbal manager."""
    return (yield from STEPS[action.number](flight, run, action))


class Manager:
    """A gimbal manager, as its GIMBAL_MANAGER_STATUS shows it."""

    def __init__(self, flight: ProcedureContext, status: dialect.MAVLink_message) -> None:
        self.component = status.get_srcComponent()
        self.addressee = 0 if self.component == flight.autopilot_component else self.component
        """Whom commands are for; 0 = the autopilot."""
        self.device = status.gimbal_device_id
        """The component of its gimbal, or one of 1 to 6 of a gimbal that is attached."""
        self.by = (status.primary_control_sysid, status.primary_control_compid)
        """Ids of who is in control; 0/0 = nobody."""

    def is_of(self, message: dialect.MAVLink_message) -> bool:
        """Whether a GIMBAL_DEVICE_ATTITUDE_STATUS is of its gimbal."""
        sender, device = message.get_srcComponent(), message.gimbal_device_id
        if self.device in ATTACHED:
            return bool(sender == self.component and device in (0, self.device))
        return bool(sender == self.device or (sender == self.component and device in (0, self.device)))


def control(flight: ProcedureContext, run: ProcedureRun, device: int) -> Generator[None, None, Manager]:
    """Be in control of a gimbal: its manager is found, and asked for the control. Raises Ended.

    `device`: the gimbal's component, one of 1 to 6 that are attached, or 0: any.
    """
    ours = (flight.commands.identity.system, flight.commands.identity.component)
    manager = yield from _manager(flight, run, lambda one: device in (0, one.device))
    if manager is None:
        raise Ended("failed", f"no gimbal manager answers{f' for gimbal {device}' if device else ''}; has it a gimbal?")
    if manager.by == ours:
        return manager
    theirs = "nobody is" if manager.by == (0, 0) else f"system {manager.by[0]} component {manager.by[1]} is"
    reason = f"{theirs} in control of the gimbal, and it did not give the control to us"
    parameters = (float(ours[0]), float(ours[1]), _LEAVE, _LEAVE, 0.0, 0.0, float(device))
    claim = BoundAction(dialect.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE, parameters, component=manager.addressee)
    command = flight.submit(run, claim)
    try:
        yield from acknowledged(flight, run, command, lambda: False)
    except Ended as ended:
        raise Ended("refused", f"{reason}: {ended.outcome.reason}") from None
    sender = manager.component
    given = yield from _manager(flight, run, lambda one: one.component == sender and one.by == ours)
    if given is None:
        raise Ended("refused", f"{reason}, though it acknowledged that")
    return given


def _manager(
    flight: ProcedureContext, run: ProcedureRun, fits: Callable[[Manager], bool]
) -> Generator[None, None, Manager | None]:
    """Wait for the state of a manager that fits: the autopilot and the gimbals are asked. None if none answers."""
    polls = [Poll(flight, run, "GIMBAL_MANAGER_STATUS", component=one) for one in (0, *flight.present(GIMBALS))]
    run.waits_for = "the state of a gimbal manager"

    def request() -> None:
        for poll in polls:
            poll()

    status = yield from next_message(
        flight,
        "GIMBAL_MANAGER_STATUS",
        MANAGER_ANSWERS_WITHIN,
        lambda message: fits(Manager(flight, message)),
        request,
    )
    return None if status is None else Manager(flight, status)


def _pointed(
    flight: ProcedureContext, run: ProcedureRun, action: BoundAction, manager: Manager, wanted: Direction
) -> Steps:
    """Send a command to the manager; the gimbal points where it was to, within the tolerance in degrees."""
    asked, watch = flight.now, _Attitude(flight, run, manager)
    near = math.radians(action.tolerance or NEAR)
    command = flight.submit(run, replace(action, component=manager.addressee), in_frame=True)

    def there() -> bool:
        actual, goal = watch.look(), wanted()
        run.waits_for, run.feedback = f"the gimbal to point there; {watch.text}", watch.figures
        return actual is not None and goal is not None and _angle(actual, goal) <= near

    yield from acknowledged(flight, run, command, lambda: False)
    if (yield from comes_true(flight, POINTS_WITHIN, there)):
        return SUCCEEDED
    return Outcome("failed", flight.with_texts(f"{command.name} was acknowledged, but {watch.text}", asked))


class _Attitude:
    """Where a gimbal points, by its last GIMBAL_DEVICE_ATTITUDE_STATUS, which is requested."""

    def __init__(self, flight: ProcedureContext, run: ProcedureRun, manager: Manager) -> None:
        self.text = "the gimbal does not report where it points (GIMBAL_DEVICE_ATTITUDE_STATUS)"
        self.figures: dict[str, float] = {}
        """Degrees: `pitch` over the horizon, `yaw` as the gimbal counts it."""
        source = manager.addressee if manager.device in (0, *ATTACHED) else manager.device
        self._flight, self._manager = flight, manager
        self._poll = Poll(flight, run, "GIMBAL_DEVICE_ATTITUDE_STATUS", component=source)
        self._direction: Triple | None = None

    def look(self) -> Triple | None:
        """Return the direction, north, east, up. Raises Ended if another has taken the control."""
        self._poll()
        message = self._flight.message
        if message is None:
            return self._direction
        match message.get_type():
            case "GIMBAL_DEVICE_ATTITUDE_STATUS" if self._manager.is_of(message):
                self._take(message)
            case "GIMBAL_MANAGER_STATUS" if message.get_srcComponent() == self._manager.component:
                by = Manager(self._flight, message).by
                if by not in (self._manager.by, (0, 0)):
                    raise Ended("failed", f"system {by[0]} component {by[1]} took control of the gimbal")
        return self._direction

    def _take(self, message: dialect.MAVLink_message) -> None:
        w, x, y, z = message.q
        if not abs(math.hypot(w, x, y, z) - 1.0) <= UNIT_NEAR:  # zeros or NaN: the gimbal does not know
            self._direction = None
            return
        ahead, right, up = 1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (w * y - x * z)
        pitch, yaw = math.asin(max(-1.0, min(1.0, up))), math.atan2(right, ahead)
        self.figures = {"pitch": round(math.degrees(pitch), 1), "yaw": round(math.degrees(yaw), 1)}
        self.text = f"it points to pitch {math.degrees(pitch):.0f}, yaw {math.degrees(yaw):.0f} degrees"
        turn = 0.0 if _yaw_is_absolute(message.flags) else self._flight.vehicle.heading
        self._direction = None if turn is None else _vector(pitch, yaw + turn)


def _yaw_is_absolute(flags: int) -> bool:
    """Whether a gimbal counts its yaw from north (GIMBAL_DEVICE_FLAGS); without either flag as its lock says."""
    if flags & (dialect.GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME | dialect.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME):
        return bool(flags & dialect.GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME)
    return bool(flags & dialect.GIMBAL_DEVICE_FLAGS_YAW_LOCK)


def _vector(pitch: float, yaw: float) -> Triple:
    """Return the unit vector north, east, up of angles in radians."""
    return math.cos(pitch) * math.cos(yaw), math.cos(pitch) * math.sin(yaw), math.sin(pitch)


def _angle(one: Triple, other: Triple) -> float:
    """Return the radians between two unit vectors."""
    return math.acos(max(-1.0, min(1.0, sum(a * b for a, b in zip(one, other, strict=True)))))
