"""How a procedure waits for the vehicle: for messages, acknowledgements, readiness, targets and landing."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.actions.context import (
    TEXT_WINDOW,
    BoundAction,
    Ended,
    Part,
    ProcedureContext,
    ProcedureRun,
)
from bridged.drivers.mavlink.vehicle.commands import MavlinkCommand
from bridged.drivers.mavlink.vehicle.state import Place
from bridged.drivers.mavlink.vehicle.streams import message_number
from schemas.manifest.loader import Retry
from schemas.wire.records import Cause

ASK_EVERY = (0.5, 0.3)
"""Mission and wall seconds between requests for a message."""
ONCE = Retry(times=0)

Fits = Callable[[dialect.MAVLink_message], bool]


class Poll:
    """Requests one message repeatedly (MAV_CMD_REQUEST_MESSAGE)."""

    def __init__(
        self,
        flight: ProcedureContext,
        run: ProcedureRun,
        name: str,
        every: tuple[float, float] = ASK_EVERY,
        component: int = 0,
    ) -> None:
        """`component` is asked for it; 0 = the autopilot."""
        self._flight, self._run, self._every = flight, run, every
        parameters = (float(message_number(name)), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        self._request = BoundAction(dialect.MAV_CMD_REQUEST_MESSAGE, parameters, ONCE, component=component)
        self._at = flight.now
        self._last: MavlinkCommand | None = None

    def __call__(self) -> None:
        """Send the request if it is due; the last one is abandoned, as its answer may be lost."""
        flight = self._flight
        if flight.now < self._at:
            return
        self._at = flight.now + flight.wait(*self._every)
        if self._last is not None:
            flight.commands.abandon(self._last)
            self._run.commands.remove(self._last)
        self._last = flight.submit(self._run, self._request)

    @property
    def refused(self) -> bool:
        """Whether the last request was refused."""
        return self._last is not None and self._last.refused


def comes_true(
    flight: ProcedureContext, patience: tuple[float, float], holds: Callable[[], bool]
) -> Generator[None, None, bool]:
    """Wait until a condition holds. Returns False if it does not within `patience`, mission and wall seconds."""
    until = flight.now + flight.wait(*patience)
    while flight.now <= until:
        if holds():
            return True
        yield
    return False


def next_message(
    flight: ProcedureContext,
    name: str,
    patience: tuple[float, float],
    fits: Fits = lambda message: True,
    request: Callable[[], None] = lambda: None,
) -> Generator[None, None, dialect.MAVLink_message | None]:
    """Wait for a message that fits, calling `request` before each look. Returns None if none arrives in time.

    `patience`: mission and wall seconds.
    """
    until = flight.now + flight.wait(*patience)
    while flight.now <= until:
        request()
        yield
        message = flight.message
        if message is not None and message.get_type() == name and fits(message):
            return message
    return None


def asked_message(
    flight: ProcedureContext,
    run: ProcedureRun,
    name: str,
    patience: tuple[float, float],
    fits: Fits = lambda message: True,
    component: int = 0,
) -> Generator[None, None, dialect.MAVLink_message | None]:
    """As `next_message`, requesting the message of a component (0: the autopilot) until it arrives.

    `patience`: mission and wall seconds.
    """
    poll = Poll(flight, run, name, component=component)
    return (yield from next_message(flight, name, patience, fits, poll))


MODE_ATTEMPTS = 4
"""Requests of a mode that is acknowledged but falls back, as ArduCopter does while it boots."""
SETTLE = (4.0, 1.5)
"""Mission and wall seconds in which an acknowledged change must show in a HEARTBEAT."""
ASK_REASONS_EVERY = (5.0, 1.0)
"""Mission and wall seconds between requests for the reasons why the vehicle is not ready."""
LASTING = (
    "not armable", "not calibrated", "calibration needed", "requires reboot", "reboot required", "safety switch",
    "below minimum arming", "internal error", "fences invalid", "no sd card", "check frame", "check fs_thr_value",
    "rtl_autoland disabled",
)  # fmt: skip
"""Parts of such texts, in lower case, whose cause needs a person (AP_Arming.cpp, AP_Arming_Copter.cpp). Others (GPS,
EKF, gyros that settle) are assumed to pass: they are waited for and reported."""
LANDED_BY_MISSION = "in landing sequence"
"""Part of the text of a plane that its mission has landed: it is armed again when the mission is at its first item."""
FAULTS = ("not healthy", "unhealthy", "not detected", "logging failed")
"""Parts of texts that may appear briefly after a start: faults if two checks in a row report them."""
FALLS, STATIONARY_FOR = 2.0, (2.0, 1.0)
"""m/s that no vehicle at rest has; mission and wall seconds around the stop of the motors in which it is judged."""
CRASH = "Crash"
"""Beginning of ArduPilot's texts of a crash (crash_check.cpp, is_flying.cpp): nothing else tells it from a landing."""
HOME_REPORTED = (5.0, 3.0)
"""Mission and wall seconds for a vehicle that has just been heard to report its home and its position."""
TARGET_ATTEMPTS = 5
TARGET_WAIT = (1.5, 0.7)
"""Mission and wall seconds for the vehicle to report the target (message 87, asked for at 2 Hz) before it is resent."""
SLOW = 0.5
"""m/s: arrived is near and not faster than this."""
ABOVE_HOME = frozenset({
    dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT, dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
})  # fmt: skip
"""Frames in which an altitude counts from home."""
TARGET_NEAR = 1.0
"""Metres between the target sent and the one reported; rounding and frame conversion cost centimetres."""


def enter(flight: ProcedureContext, run: ProcedureRun, action: BoundAction, mode: int) -> Part:
    """Send a command that changes the mode until it sticks. `mode`: its number in HEARTBEAT.custom_mode.

    A target where the vehicle is in the mode already must be acknowledged: the mode does not show it.
    """
    vehicle, before = flight.vehicle, flight.vehicle.mode
    asked, name = flight.now, flight.vehicle.modes.name(mode)
    shows = action.number not in (dialect.MAV_CMD_DO_REPOSITION, dialect.MAV_CMD_DO_ORBIT) or before != mode

    def shown() -> bool:
        return vehicle.mode == mode

    cause: Cause = "driver"
    for _ in range(MODE_ATTEMPTS):
        flight.expect_mode(mode)
        command = flight.submit(run, action, in_frame=True)
        yield from acknowledged(flight, run, command, shown if shows else lambda: False)
        flight.expect_mode(mode)
        run.waits_for = f"two HEARTBEATs in {name}; the vehicle is in {vehicle.mode_name}"
        appeared = yield from appears(flight, shown)
        if appeared and (yield from lasts(flight, shown)):
            return
        others = vehicle.mode not in (before, mode) and before not in vehicle.modes.booting
        if others or (vehicle.armed and (appeared or run.by_agent)):  # it is not taken again from a pilot or a failsafe
            cause = "pilot" if vehicle.armed else "driver"
            break
        before = vehicle.mode
    reason = f"{name} was acknowledged, but the vehicle is in {vehicle.mode_name}"
    raise Ended("failed", flight.with_texts(reason, asked), cause)


def acknowledged(
    flight: ProcedureContext, run: ProcedureRun, command: MavlinkCommand, effect: Callable[[], bool]
) -> Part:
    """Wait until a command is accepted, or its effect shows anyway; a refusal and silence end the procedure.

    A refusal of a repetition may mean that the first one worked, so the effect is waited for longer then. Only a
    HEARTBEAT after it shows that an unacknowledged command had no effect; the loss of the link ends the procedure.
    """
    vehicle, asked, silent_at = flight.vehicle, flight.now, math.inf
    while not effect() and not command.accepted:
        if command.refused:
            if (yield from comes_true(flight, TEXT_WINDOW if command.sent == 1 else SETTLE, effect)):
                return
            raise Ended("refused", flight.refusal(command, asked))
        run.waits_for = f"the acknowledgement of {command.name}"
        if command.silent:
            silent_at = min(silent_at, flight.now)
            if vehicle.heard_at > silent_at:
                reason = f"no acknowledgement of {command.name} after sending it {command.sent} times, and no effect"
                raise Ended("failed", f"{reason}; {flight.state_text()}", "link")
            run.waits_for = f"a HEARTBEAT that shows whether {command.name} had an effect"
        yield
    command.may_repeat = lambda: False


def steady(flight: ProcedureContext, shown: Callable[[], bool]) -> Generator[None, None, bool]:
    """Whether a state shows soon and still does at the next HEARTBEAT."""
    return (yield from appears(flight, shown)) and (yield from lasts(flight, shown))


def appears(flight: ProcedureContext, shown: Callable[[], bool]) -> Generator[None, None, bool]:
    """Whether a state shows soon.

    Only a HEARTBEAT denies it: silence proves nothing, and the loss of the link ends the procedure.
    """
    vehicle, patience = flight.vehicle, flight.now + flight.wait(*SETTLE)
    while not shown():
        if vehicle.heard_at > patience:
            return False
        yield
    return True


def lasts(flight: ProcedureContext, shown: Callable[[], bool]) -> Generator[None, None, bool]:
    """Whether a state that shows still does at the next HEARTBEAT."""
    beats = flight.vehicle.heartbeats
    while shown() and flight.vehicle.heartbeats == beats:
        yield
    return shown()


def ready(flight: ProcedureContext, run: ProcedureRun) -> Part:
    """Wait until the vehicle is ready to be armed, asking it for its reasons meanwhile.

    A reason that does not go away by waiting ends the procedure.
    """
    before = asked = ask_at = flight.now
    named_before: set[str] = set()
    restarted = False
    while missing := flight.vehicle.not_ready():
        answered = flight.now - asked > flight.wait(*TEXT_WINDOW)
        texts = sorted(flight.texts.beginning(flight.autopilot.pre_arm, asked if answered else before))
        run.cause = "; ".join(texts or missing)
        run.waits_for = "readiness: " + "; ".join([*missing, *texts])
        faults = named_before.intersection(texts if answered else ())
        lasting = {one for one in texts if any(part in one.lower() for part in LASTING)}
        if lasting := lasting | {one for one in faults if any(part in one.lower() for part in FAULTS)}:
            raise Ended(
                "refused", f"the vehicle refuses to arm until a person corrects this: {'; '.join(sorted(lasting))}"
            )
        if not restarted and any(LANDED_BY_MISSION in one.lower() for one in texts):
            restarted = True
            flight.send(dialect.MAVLink_mission_set_current_message(*flight.addressee, 1))
        if flight.now >= ask_at and flight.vehicle.connected:
            named_before = set(flight.texts.beginning(flight.autopilot.pre_arm, asked))
            before, asked, ask_at = asked, flight.now, flight.now + flight.wait(*ASK_REASONS_EVERY)
            flight.submit(run, BoundAction(dialect.MAV_CMD_RUN_PREARM_CHECKS, retry=ONCE))
        yield
    run.cause = ""


def check_guided_aloft(flight: ProcedureContext, what: str) -> None:
    """Refuse targets that the vehicle would ignore: it accepts them only in GUIDED and in flight. Raises Ended."""
    vehicle = flight.vehicle
    if vehicle.mode not in vehicle.modes.targets:
        wanted = vehicle.modes.name(vehicle.modes.guided)
        raise Ended("refused", f"{what} are taken in {wanted} only; {flight.state_text()}")
    if not vehicle.aloft:
        when = "armed" if vehicle.modes.ground else "in flight"
        raise Ended("refused", f"{what} are taken {when} only; {flight.state_text()}")


def target_taken(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Part:
    """Send the target until the vehicle reports it as its own."""
    asked = flight.now
    if action.target is None:
        raise ValueError(f"{run.name}: an action without a target")
    yield from home_reported_for_limits(flight, run, action)
    check_guided_aloft(flight, "position targets")
    check_limits(flight, action)
    for attempt in range(TARGET_ATTEMPTS):
        command = flight.autopilot.offer_target(flight, run, action)
        if (yield from target_shown(flight, run, action, ask=attempt > 0)):
            return
        if command is not None and command.refused:
            raise Ended("refused", flight.refusal(command, asked))
        if not flight.vehicle.armed:
            raise Ended("failed", flight.with_texts("the vehicle disarmed", asked))
    reason = f"the vehicle did not take the target in {TARGET_ATTEMPTS} tries (outside a fence, or out of reach?)"
    raise Ended("refused", flight.with_texts(f"{reason}, {own_target(flight, action)}", asked))


def home_reported(flight: ProcedureContext, run: ProcedureRun) -> Part:
    """Wait, within bounds, until the vehicle has reported its home and its position: it may just have been heard."""
    request = Poll(flight, run, "HOME_POSITION")
    run.waits_for = "the vehicle to report its home and its position"

    def known() -> bool:
        if flight.vehicle.home is None:
            request()
        return from_home(flight) is not None

    yield from comes_true(flight, HOME_REPORTED, known)


def home_reported_for_limits(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Part:
    """As `home_reported`, if the mission's limits for the target of an action count from home."""
    if action.limited and flight.limited:
        yield from home_reported(flight, run)


def check_limits(flight: ProcedureContext, action: BoundAction, around: float = 0.0) -> None:
    """Refuse a target outside the mission's limits, or one whose altitude above home is not known yet. Raises Ended.

    `around`: metres that the vehicle flies around it.
    """
    if flight.altitude_of_home() is None:
        raise Ended("refused", "the vehicle's altitude is not known yet")
    if action.limited and flight.limited and not flight.vehicle.placed:
        reason = "the vehicle has not reported its position lately, so the mission's limits cannot be kept"
        raise Ended("refused", reason, "limits")
    if action.limited and (broken := flight.outside_limits(above_home(flight, action), around)):
        raise Ended("refused", broken, "limits")


def target_shown(
    flight: ProcedureContext, run: ProcedureRun, action: BoundAction, *, ask: bool
) -> Generator[None, None, bool]:
    """Whether the vehicle reports the target of an action as its own before long; `ask`: request its report.

    Only a HEARTBEAT denies it: sent again, the target could take the vehicle from a pilot who is not seen yet.
    """
    vehicle, seen = flight.vehicle, flight.vehicle.targets
    patience = flight.now + flight.wait(*TARGET_WAIT)
    request = Poll(flight, run, "POSITION_TARGET_GLOBAL_INT")
    run.waits_for = "the vehicle to report the target as its own"
    while vehicle.armed and (flight.now <= patience or vehicle.heard_at <= patience):
        if ask:
            request()
        yield
        if vehicle.targets > seen and target_is(flight, action):
            return True
    return False


def target_is(flight: ProcedureContext, action: BoundAction) -> bool:
    """Whether the target that the vehicle reported last is that of an action."""
    own, wanted = flight.vehicle.target, action.target
    if own is None or wanted is None:
        return False
    height = wanted.altitude + ((flight.altitude_of_home() or 0.0) if action.frame in ABOVE_HOME else 0.0)
    level = flight.vehicle.modes.ground or abs(own.altitude - height) <= TARGET_NEAR
    return own.distance(wanted) <= TARGET_NEAR and level


def own_target(flight: ProcedureContext, action: BoundAction) -> str:
    """Return the vehicle's own target, for people."""
    own = flight.vehicle.target
    if own is None or action.target is None:
        return "it reports no target of its own"
    return f"its own target is {own.distance(action.target):.0f} m from there"


def above_home(flight: ProcedureContext, action: BoundAction) -> Place:
    """Return the target of an action with its altitude in metres above home."""
    target = action.target or Place(0.0, 0.0, 0.0)
    if action.frame in ABOVE_HOME:
        return target
    return Place(target.latitude, target.longitude, target.altitude - (flight.altitude_of_home() or 0.0))


def down(flight: ProcedureContext, run: ProcedureRun) -> Part:
    """Wait until the vehicle has landed and disarmed; motors that stop elsewhere end the procedure."""
    vehicle, fast_at = flight.vehicle, -math.inf
    while vehicle.armed or not vehicle.connected:
        fast_at = flight.now if vehicle.speed > FALLS else fast_at
        position, away = vehicle.position, from_home(flight)
        if position is not None:
            run.feedback = {"altitude": round(position.altitude, 2)}
            if away is not None:
                run.feedback["distance"] = round(away, 2)
            run.waits_for = f"landing and disarming; it is at {position.altitude:.1f} m, {metres(away)} from home"
        yield
    yield from stationary(flight, run, fast_at)


def stationary(flight: ProcedureContext, run: ProcedureRun, fast_at: float, where: str = "") -> Part:
    """Judge whether motors that have just stopped did so on the ground; else the procedure has failed.

    A vehicle that does not move before and after has landed, on a hill too; one that falls is fast. A disarmed
    vehicle reports itself as landed wherever it is. `fast_at` is when it was last faster than `FALLS`, in mission
    seconds; `where` is for people.
    """
    vehicle, asked, seen = flight.vehicle, flight.now, flight.vehicle.positions
    until = asked + flight.wait(*STATIONARY_FOR)
    while flight.now <= until:
        run.waits_for = "the vehicle to stand on the ground"
        fast_at = flight.now if vehicle.speed > FALLS else fast_at
        yield
    if vehicle.armed:
        raise Ended("failed", f"the vehicle was armed again{where}; {flight.state_text()}")
    if vehicle.positions == seen:
        reason = f"the motors have stopped{where}, and the vehicle does not report where it is"
        raise Ended("failed", flight.with_texts(reason, asked))
    if asked - fast_at <= flight.wait(*STATIONARY_FOR):
        raise Ended("failed", flight.with_texts(f"the motors stopped in the air{where}", asked))
    if flight.texts.beginning(CRASH, before := asked - flight.wait(*STATIONARY_FOR)):
        raise Ended("failed", flight.with_texts(f"the vehicle has crashed{where}", before))


def parked(flight: ProcedureContext) -> bool:
    """Whether the vehicle rests disarmed."""
    vehicle = flight.vehicle
    return vehicle.connected and not vehicle.armed and vehicle.speed <= FALLS


def from_home(flight: ProcedureContext) -> float | None:
    """Return the horizontal distance from home in metres, None if it is not known."""
    position, home = flight.vehicle.position, flight.vehicle.home
    return None if position is None or home is None else home.distance(position)


def metres(distance: float | None) -> str:
    """Return a distance in metres for people; None = it is not known."""
    return "an unknown distance" if distance is None else f"{distance:.1f} m"
