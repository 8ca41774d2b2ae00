"""Flying the stored mission: read and checked first, watched to its end, not changed by us meanwhile."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Outcome
from bridged.drivers.mavlink.actions.confirmation import (
    FALLS,
    Poll,
    acknowledged,
    asked_message,
    enter,
    from_home,
    metres,
    stationary,
)
from bridged.drivers.mavlink.actions.context import (
    SUCCEEDED,
    BoundAction,
    Ended,
    Part,
    Plan,
    ProcedureContext,
    ProcedureRun,
    Steps,
    mode_action,
)
from bridged.drivers.mavlink.actions.mission_actions import (
    download,
    go_to_item,
    mission_protocol,
    outside,
    report_items,
    same_items,
)
from bridged.drivers.mavlink.actions.mission_items import Item
from schemas.manifest.loader import Retry

PROGRESS_EVERY = (1.0, 0.5)
"""Mission and wall seconds between requests for MISSION_CURRENT."""
END_SHOWS = (3.0, 2.0)
"""Mission and wall seconds in which a vehicle that left AUTO by itself reports that its mission is over."""
BEGINS_WITHIN = (15.0, 3.0)
"""Mission and wall seconds in which a vehicle on the ground must take off for its mission."""
HOME_NEAR = 3.0
"""Metres from home at which a vehicle has returned."""
PASSED_WITHIN, TOLD_WITHIN = 200.0, (3.0, 2.0)
"""Metres from a waypoint within which a vehicle has passed it; mission and wall seconds between two MISSION_CURRENT in
which it is judged whether it has."""
WAYPOINTS = frozenset({dialect.MAV_CMD_NAV_WAYPOINT, dialect.MAV_CMD_NAV_SPLINE_WAYPOINT})
COMPLETE = dialect.MISSION_STATE_COMPLETE
START = Retry(times=5)
SHOWS_WITHIN = (2.5, 1.5)
"""Mission and wall seconds in which MISSION_CURRENT comes: each second, if it is not sent when it is asked for."""


def enter_mode(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """DO_SET_MODE: the mode shows, and still does at the next HEARTBEAT; AUTO only on a mission that may be flown."""
    if action.mode == flight.vehicle.modes.auto:
        yield from may_fly(flight, run)
    yield from enter(flight, run, action, action.mode)
    return SUCCEEDED


def may_fly(flight: ProcedureContext, run: ProcedureRun) -> Part:
    """Check a mission before the vehicle flies it: it must be complete, and within the limits if there are any."""
    if flight.plan.broken:
        raise Ended("refused", flight.plan.broken)
    if flight.limited:
        yield from _read_within_limits(flight, run)


def start_mission(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """`mission_start`: AUTO, then every item to the last; on the ground a mission begins with a takeoff.

    What the vehicle stores is read first, whoever has stored it: another station may have since we did.
    """
    vehicle, modes = flight.vehicle, flight.vehicle.modes
    if flight.plan.broken:
        return Outcome("refused", flight.plan.broken)
    if not vehicle.armed:
        return Outcome("refused", f"a mission is started armed; {flight.state_text()}")
    yield from _read_within_limits(flight, run)
    items = flight.plan.items or ()
    last = max((seq for seq, item in enumerate(items) if seq and item.flown), default=0)
    if not last:
        nothing = "nothing in the vehicle's mission is flown" if len(items) > 1 else "the vehicle has no mission"
        return Outcome("refused", f"{nothing}; upload one")
    with _flying(flight.plan, run.name):
        current = yield from asked_message(flight, run, "MISSION_CURRENT", SHOWS_WITHIN)
        if current is not None and (current.mission_state == COMPLETE or current.seq > last):
            yield from go_to_item(flight, run, 1)
        grounded = not vehicle.aloft or modes.ground
        if vehicle.mode != modes.auto:  # whether it stays is seen all the way
            flight.expect_mode(modes.auto)
            command = flight.submit(run, replace(mode_action(modes, modes.auto), retry=START))
            yield from acknowledged(flight, run, command, lambda: vehicle.mode == modes.auto)
            flight.expect_mode(modes.auto)
        if grounded:
            command = flight.submit(run, BoundAction(dialect.MAV_CMD_MISSION_START, retry=START))
            yield from acknowledged(flight, run, command, lambda: vehicle.aloft and not modes.ground)
        stored = None if current is None else current.total
        return (yield from _fly(flight, run, items, last, stored, grounded=grounded and not modes.ground))


def _fly(
    flight: ProcedureContext,
    run: ProcedureRun,
    items: tuple[Item, ...],
    last: int,
    stored: int | None,
    *,
    grounded: bool,
) -> Steps:
    """Watch the mission until it is over; its progress comes from the vehicle's own messages.

    A vehicle that disarms calls its mission complete wherever it is, so the end in the air is believed at the next
    HEARTBEAT, and the end on the ground when the motors have stopped at the last item. One that leaves AUTO at the end
    of a mission does so immediately: two HEARTBEATs later a change is somebody else's. Of a mission that jumps,
    reaching an item proves nothing: it is over when the vehicle reports it. A failsafe of ArduPlane goes on to the
    landing in AUTO. `stored` is the number of items in the last MISSION_CURRENT before.
    """
    vehicle, modes, asked = flight.vehicle, flight.vehicle.modes, flight.now
    poll, patience = Poll(flight, run, "MISSION_CURRENT", PROGRESS_EVERY), flight.now + flight.wait(*BEGINS_WITHIN)
    jumps, complete = any(item.command == dialect.MAV_CMD_DO_JUMP for item in items), False
    reached, furthest, current, running, over_at, left_at = 0, 0, 1, False, math.inf, None
    fast_at, before, told_at, flight.plan.sent_to = -math.inf, 0, -math.inf, 0
    while True:
        poll()
        fast_at = flight.now if vehicle.speed > FALLS else fast_at
        message = flight.message
        match message:
            case dialect.MAVLink_mission_item_reached_message():
                reached = message.seq if jumps else max(reached, message.seq)
            case dialect.MAVLink_mission_current_message():
                stored = message.total if stored is None else stored
                if message.total != stored or message.mission_state == dialect.MISSION_STATE_NO_MISSION:
                    reason = "the vehicle's mission was changed by others while it was flown (another ground station?)"
                    return Outcome("failed", flight.with_texts(reason, asked))
                lately = flight.now - told_at <= flight.wait(*TOLD_WITHIN)
                if lately and not jumps and message.seq != flight.plan.sent_to:
                    _check_passed(flight, items, before, message.seq, asked)
                before, told_at = message.seq, flight.now
                furthest = max(furthest, message.seq)
                current = max(1, message.seq if jumps else furthest)
                complete = complete or (message.mission_state == COMPLETE and running and vehicle.armed)
                running = running or message.mission_state == dialect.MISSION_STATE_ACTIVE
        reached = last if complete else reached
        grounded = grounded and not vehicle.aloft
        _progress(flight, run, items, current, last, reached)
        if items[last].ends_on_ground:
            if not vehicle.armed and max(furthest, reached) >= last:
                return (yield from _landed(flight, run, items[last], fast_at))
        elif (complete or (reached >= last and not jumps)) and vehicle.armed and not grounded:
            over_at = min(over_at, vehicle.heartbeats)
            stays = vehicle.mode == modes.auto != modes.after_mission
            if vehicle.mode in (modes.auto, modes.after_mission) and vehicle.heartbeats > over_at + stays:
                if modes.ground and stays:  # armed again in AUTO it would drive off
                    yield from enter(flight, run, mode_action(modes, modes.after_mission), modes.after_mission)
                return SUCCEEDED
        over = over_at < math.inf and vehicle.mode == modes.after_mission
        returning = vehicle.mode == modes.rtl and items[last].command == dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH
        flown = vehicle.mode == modes.auto or over or (returning and max(furthest, reached) >= last)
        if vehicle.armed and flown and not vehicle.failsafe_acts:
            left_at = None
        else:
            left_at = flight.now if left_at is None else left_at
            if vehicle.heard_at - left_at > flight.wait(*END_SHOWS):  # a HEARTBEAT says so, and none before the start
                return _broken_off(flight, reached, last, asked)
        if grounded and flight.now > patience:
            reason = "the mission was started, but the vehicle did not leave the ground; does it begin with a takeoff?"
            return Outcome("failed", flight.with_texts(reason, asked))
        yield


def _check_passed(flight: ProcedureContext, items: tuple[Item, ...], before: int, seq: int, asked: float) -> None:
    """Raise Ended if the vehicle goes on from item `before` to item `seq` without having been at those between."""
    vehicle = flight.vehicle
    if vehicle.position is None or not vehicle.placed:
        return
    near = PASSED_WITHIN + vehicle.speed * flight.wait(*TOLD_WITHIN)
    for item in range(max(1, before), min(seq, len(items))):
        if items[item].command in WAYPOINTS and vehicle.position.distance(items[item].place) > near:
            reason = f"the vehicle goes on to item {seq} and was not at item {item}, which nobody here asked for"
            said = flight.with_texts(f"{reason} (a failsafe, or another ground station?)", asked)
            raise Ended("failed", said, "pilot")


def _landed(flight: ProcedureContext, run: ProcedureRun, item: Item, fast_at: float) -> Steps:
    """Whether the motors stopped on the ground at the last item, and at home if the item requires it."""
    yield from stationary(flight, run, fast_at, " at the last item of the mission")
    away = from_home(flight)
    if item.command == dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH and (away is None or away > HOME_NEAR):
        return Outcome("failed", f"the vehicle landed {metres(away)} from home")
    return SUCCEEDED


def _progress(
    flight: ProcedureContext, run: ProcedureRun, items: tuple[Item, ...], current: int, last: int, reached: int
) -> None:
    run.feedback = {"item": float(current), "items": float(last), "reached": float(reached)}
    where = flight.vehicle.position
    if where is not None:
        run.feedback["altitude"] = round(where.altitude, 2)
        if current < len(items) and items[current].placed:
            run.feedback["distance"] = round(where.distance(items[current].place), 2)
    run.waits_for = f"the end of the mission; it is at item {current} of {last}"


def _broken_off(flight: ProcedureContext, reached: int, last: int, asked: float) -> Outcome:
    vehicle = flight.vehicle
    how = (
        f"the mode became {vehicle.mode_name}, which nobody here asked for ({flight.others})"
        if vehicle.armed
        else "the vehicle disarmed"
    )
    reason = f"{how} before the end of the mission (item {reached} of {last})"
    return Outcome("failed", flight.with_texts(reason, asked), "pilot" if vehicle.armed else "driver")


def _read_within_limits(flight: ProcedureContext, run: ProcedureRun) -> Part:
    """Read the stored mission, which must be within the limits; percepts follow."""
    with mission_protocol(flight, run):
        held = yield from download(flight, run)
    if flight.plan.items is None or not same_items(held, flight.plan.items):
        flight.plan.items = held
        report_items(flight)
    if broken := outside(flight, held[1:]):
        raise Ended("refused", broken, "limits")


@contextmanager
def _flying(plan: Plan, name: str) -> Iterator[None]:
    """Reserve the mission for the action of a name, so that it is not changed meanwhile."""
    plan.flown_by = name
    try:
        yield
    finally:
        plan.flown_by = ""
