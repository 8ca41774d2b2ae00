"""The mission protocol from our side (MAVLink devguide, mission.md): items sent, read back and cleared.

The vehicle leads an upload: it asks for each item, and asks again. Everything is bounded, and what
remains of an interrupted upload is reported.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Outcome, Reading
from bridged.drivers.mavlink.actions.confirmation import Poll, home_reported, next_message
from bridged.drivers.mavlink.actions.context import (
    SUCCEEDED,
    TEXT_WINDOW,
    UNKNOWN_MISSION,
    BoundAction,
    Ended,
    Part,
    ProcedureContext,
    ProcedureRun,
    Steps,
)
from bridged.drivers.mavlink.actions.mission_items import AMSL, MAX_ITEMS, RELATIVE, Item, item_of, read_items
from bridged.drivers.mavlink.vehicle.state import Place

TRIES = 6
TRY_EVERY = (1.0, 1.0)
"""Mission and wall seconds before we ask again."""
VEHICLE_GIVES_UP = (9.0, 6.0)
"""Mission and wall seconds of silence after which an upload is over: the vehicle asks again every second, for 8 s."""
RESULTS = {
    dialect.MAV_MISSION_ERROR: "it failed",
    dialect.MAV_MISSION_UNSUPPORTED_FRAME: "the frame of an item is not supported",
    dialect.MAV_MISSION_UNSUPPORTED: "a command is not supported",
    dialect.MAV_MISSION_NO_SPACE: "the vehicle has no space for all items",
    dialect.MAV_MISSION_INVALID: "an item is invalid",
    dialect.MAV_MISSION_INVALID_PARAM1: "param1 of an item is invalid",
    dialect.MAV_MISSION_INVALID_PARAM2: "param2 of an item is invalid",
    dialect.MAV_MISSION_INVALID_PARAM3: "param3 of an item is invalid",
    dialect.MAV_MISSION_INVALID_PARAM4: "param4 of an item is invalid",
    dialect.MAV_MISSION_INVALID_PARAM5_X: "the latitude of an item is invalid",
    dialect.MAV_MISSION_INVALID_PARAM6_Y: "the longitude of an item is invalid",
    dialect.MAV_MISSION_INVALID_PARAM7: "the altitude of an item is invalid",
    dialect.MAV_MISSION_INVALID_SEQUENCE: "no such item, or out of order",
    dialect.MAV_MISSION_DENIED: "it does not take missions from us",
    dialect.MAV_MISSION_OPERATION_CANCELLED: "it gave up waiting for items",
}
"""Texts of MISSION_ACK.type."""
MISSION, FENCE, RALLY = (
    dialect.MAV_MISSION_TYPE_MISSION, dialect.MAV_MISSION_TYPE_FENCE, dialect.MAV_MISSION_TYPE_RALLY,
)  # fmt: skip
LISTS = {MISSION: "mission", FENCE: "fence", RALLY: "list of rally points"}
"""Names of the lists for people."""
log = logging.getLogger("mavlink")


def upload(flight: ProcedureContext, run: ProcedureRun, items: tuple[Item, ...]) -> Part:
    """Send the items; the first is home. The vehicle must hold as many as were sent.

    An acknowledgement that is lost proves nothing: then the items are read back and compared.
    """
    count, plan, before, last = len(items), flight.plan, flight.plan.broken, 0
    plan.items = None

    def begun(sent: int) -> None:  # ArduPilot cuts its mission to the length announced, and stores items as they arrive
        nonlocal last
        last = sent
        plan.broken = (
            f"the upload was broken off {f'at item {sent - 1} of {count - 1}' if sent else 'after it was announced'}: "
            f"{UNKNOWN_MISSION}"
        )
        run.leaves = plan.broken

    try:
        acknowledged = yield from send_items(flight, run, items, MISSION, begun)
    except Ended as ended:
        if ended.outcome.state == "refused" and not last:  # it has kept what it had
            plan.broken = before
        raise
    if not acknowledged:
        try:
            held = yield from download(flight, run)
        except Ended:  # what it holds is not known
            held = ()
        if not same_items(held, items):
            raise Ended("failed", f"the vehicle did not acknowledge the mission; {plan.broken}")
    run.leaves = ""
    held_count = yield from count_items(flight, run)
    uncounted = flight.vehicle.home is None  # home counts as an item once the vehicle has one
    if held_count != count and not (uncounted and held_count == count - 1):
        readback = (
            "does not report how many items it holds" if held_count is None else f"holds {held_count} items with home"
        )
        raise Ended("failed", f"the mission of {count} items with home was acknowledged, but the vehicle {readback}")
    plan.items, plan.broken = items, ""


def send_items(
    flight: ProcedureContext, run: ProcedureRun, items: tuple[Item, ...], kind: int, begun: Callable[[int], None]
) -> Generator[None, None, bool]:
    """Send a list of items (MAV_MISSION_TYPE) as the vehicle requests them. Returns whether it acknowledged them all.

    `begun` is called when they are announced (0), and with how many have been sent; it sets `run.leaves`. Raises Ended
    if the vehicle refuses them, or falls silent before it has requested the last.
    """
    what, first = LISTS[kind], int(kind == MISSION)  # home is no item to people
    count, sent, tries = len(items), 0, 0
    again_at = quiet_since = flight.now
    while True:
        if not sent and flight.now >= again_at:
            if tries >= TRIES:
                left, run.leaves = run.leaves, ""
                raise Ended("failed", f"the vehicle did not request the {what}, announced {TRIES} times; {left}")
            begun(0)
            tries, again_at = tries + 1, flight.now + flight.wait(*TRY_EVERY)
            flight.send(dialect.MAVLink_mission_count_message(*flight.addressee, count, kind))
        run.feedback = {"item": float(max(0, sent - first)), "items": float(count - first)}
        run.waits_for = f"the vehicle to take item {sent} of {count}"
        yield
        message = flight.message
        if message is not None and message.get_type().startswith("MISSION_") and ours(flight, message, kind):
            match message.get_type():
                case "MISSION_REQUEST" | "MISSION_REQUEST_INT" if message.seq < count:
                    quiet_since, sent = flight.now, max(sent, message.seq + 1)
                    begun(sent)
                    item = items[message.seq]
                    flight.send(
                        dialect.MAVLink_mission_item_int_message(
                            *flight.addressee, message.seq, item.frame, item.command, 0, item.autocontinue,
                            *item.parameters, item.x, item.y, item.z, kind,
                        )
                    )  # fmt: skip
                case "MISSION_ACK" if message.type == dialect.MAV_MISSION_ACCEPTED:
                    if sent == count:  # any other is a late one, of an exchange before
                        return True
                case "MISSION_ACK" if message.type != dialect.MAV_MISSION_INVALID_SEQUENCE or not sent:
                    left, run.leaves = f"; {run.leaves}" if sent else "", ""
                    raise Ended("refused", f"the vehicle refused the {what}: {_result(message)}{left}")
        if sent and flight.now - quiet_since > flight.wait(*VEHICLE_GIVES_UP):
            if sent < count:
                left, run.leaves = run.leaves, ""
                raise Ended("failed", f"the vehicle fell silent during the upload; {left}")
            return False


def download(flight: ProcedureContext, run: ProcedureRun) -> Generator[None, None, tuple[Item, ...]]:
    """Read the vehicle's mission. Returns its items, home first."""
    count = yield from count_items(flight, run)
    if count is None:
        raise Ended("failed", f"the vehicle did not send its mission, asked {TRIES} times")
    if count > MAX_ITEMS + 1:
        raise Ended("failed", f"the vehicle reports {count} items; {MAX_ITEMS} are read at most")
    items = [] if flight.autopilot.home_is_an_item or not count else [_home(flight)]
    for seq in range(len(items), count):
        run.feedback = {"item": float(seq), "items": float(max(0, count - 1))}
        run.waits_for = f"item {seq} of {count} from the vehicle"
        items.append((yield from _read(flight, seq)))
    flight.send(dialect.MAVLink_mission_ack_message(*flight.addressee, dialect.MAV_MISSION_ACCEPTED))
    return tuple(items)


def count_items(flight: ProcedureContext, run: ProcedureRun, kind: int = 0) -> Generator[None, None, int | None]:
    """Request how many items of a list (MAV_MISSION_TYPE) the vehicle holds, a mission's with home.

    Returns None without an answer.
    """
    run.waits_for = "the vehicle to report how many items it holds"
    for _ in range(TRIES):
        flight.send(dialect.MAVLink_mission_request_list_message(*flight.addressee, kind))
        message = yield from next_message(flight, "MISSION_COUNT", TRY_EVERY, lambda one: ours(flight, one, kind))
        if message is not None:
            return int(message.count)
    return None


def clear(flight: ProcedureContext, run: ProcedureRun) -> Part:
    """Clear the vehicle's mission, until it holds none but home."""
    for _ in range(TRIES):
        flight.send(dialect.MAVLink_mission_clear_all_message(*flight.addressee))
        run.waits_for = "the vehicle to clear its mission"
        message = yield from next_message(flight, "MISSION_ACK", TRY_EVERY, lambda one: ours(flight, one))
        if message is not None and message.type != dialect.MAV_MISSION_ACCEPTED:
            raise Ended("refused", f"the vehicle refused to clear its mission: {_result(message)}")
        held = yield from count_items(flight, run)
        if held is not None and held <= 1:
            return
    raise Ended("failed", "the vehicle still holds a mission, or does not report it")


def _read(flight: ProcedureContext, seq: int) -> Generator[None, None, Item]:
    for _ in range(TRIES):
        flight.send(dialect.MAVLink_mission_request_int_message(*flight.addressee, seq))
        until = flight.now + flight.wait(*TRY_EVERY)
        while flight.now <= until:
            yield
            message = flight.message
            if message is None or not message.get_type().startswith("MISSION_") or not ours(flight, message):
                continue
            match message.get_type():
                case "MISSION_ITEM_INT" | "MISSION_ITEM" if message.seq == seq:
                    return item_of(message)
                case "MISSION_ACK" if message.type != dialect.MAV_MISSION_ACCEPTED:
                    raise Ended("failed", f"the vehicle did not send item {seq}: {_result(message)}")
    raise Ended("failed", f"the vehicle did not send item {seq} of its mission, asked {TRIES} times")


def ours(flight: ProcedureContext, message: dialect.MAVLink_message, kind: int = 0) -> bool:
    """Whether it is for us, and of the list of a kind (MAV_MISSION_TYPE): the mission's, not the fence's."""
    for_us = hasattr(message, "target_system") and flight.commands.identity.is_addressed(message)
    return for_us and getattr(message, "mission_type", 0) == kind


def _result(message: dialect.MAVLink_message) -> str:
    return RESULTS.get(message.type, f"result {message.type}")


def same_items(held: tuple[Item, ...], items: tuple[Item, ...]) -> bool:
    """Whether two lists of items are the same to a vehicle; home is its own."""
    return len(held) == len(items) and all(one.same(other) for one, other in zip(held[1:], items[1:], strict=True))


SET_CURRENT_TRIES = 4
JUDGED_WITHIN = (3.5, 3.0)
"""Mission and wall seconds: PX4 judges 0.2 s after it has acknowledged, and reports each second."""
MOVES_HOME = "it moves home, from where the mission's limits are measured"


def upload_mission(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """`mission_upload`: every item within the limits, acknowledged, and as many counted back.

    With `home_first` the first item is home, as in ArduPilot's own numbering: the vehicle keeps its own.
    """
    given = action.arguments["items"]
    if action.arguments.get("home_first") is True and isinstance(given, list):
        given = given[1:]
    try:
        items = read_items(given, AMSL if action.frame == dialect.MAV_FRAME_GLOBAL_INT else RELATIVE)
    except ValueError as error:
        return Outcome("refused", str(error))
    return (yield from upload_within_limits(flight, run, items))


def upload_within_limits(flight: ProcedureContext, run: ProcedureRun, items: tuple[Item, ...]) -> Steps:
    """Store the items of a mission, without home, if each is within the limits."""
    if flown := flown_now(flight):
        return Outcome("refused", flown)
    if flight.limited:
        yield from home_reported(flight, run)
    if broken := outside(flight, items):
        return Outcome("refused", broken, "limits")
    if not flight.autopilot.home_is_an_item:
        items = _placed(flight, items)
    with mission_protocol(flight, run):
        yield from upload(flight, run, (_home(flight), *items))
        yield from _judged(flight, run)
        report_items(flight)
    return SUCCEEDED


def _placed(flight: ProcedureContext, items: tuple[Item, ...]) -> tuple[Item, ...]:
    """Return items that are flown "here" (0/0) with the place before them: PX4 has no such place."""
    before, placed = flight.vehicle.position or flight.vehicle.home, []
    for item in items:
        if item.placed:
            before = item.place
        elif item.flown and before is not None:
            item = replace(item, x=round(before.latitude * 1e7), y=round(before.longitude * 1e7))
        placed.append(item)
    return tuple(placed)


def _judged(flight: ProcedureContext, run: ProcedureRun) -> Part:
    """Wait until the vehicle has judged the mission that it stored, where it does so after its acknowledgement."""
    if not flight.autopilot.judges_missions_later:
        return
    asked = flight.now
    run.waits_for = "the vehicle to report whether the mission can be flown"
    settled = flight.now + flight.wait(*TEXT_WINDOW)
    message = yield from next_message(flight, "MISSION_CURRENT", JUDGED_WITHIN, lambda one: flight.now >= settled)
    if message is None or message.mission_state != dialect.MISSION_STATE_NO_MISSION:
        return
    reason = "the vehicle has stored the mission, and reports that it cannot be flown"
    raise Ended("refused", flight.with_texts(reason, asked))


def download_mission(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """`mission_download`: every item has arrived; they become readings of MISSION and MISSION_LIST."""
    with mission_protocol(flight, run):
        held = yield from download(flight, run)
        flight.plan.items, flight.plan.broken = held, ""
        report_items(flight)
    return SUCCEEDED


def clear_mission(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """`mission_clear`: the vehicle counts no items but home."""
    if flown := flown_now(flight):
        return Outcome("refused", flown)
    with mission_protocol(flight, run):
        yield from clear(flight, run)
        flight.plan.items, flight.plan.broken = (_home(flight),), ""
        report_items(flight)
    return SUCCEEDED


def set_current(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """`mission_set_current`: MISSION_CURRENT shows the item."""
    wanted = action.arguments["seq"]
    if not isinstance(wanted, int):
        return Outcome("refused", f"an item is a whole number, got {wanted!r}")
    known = flight.plan.items
    if known is not None and not 0 < wanted < len(known):
        return Outcome("refused", f"no item {wanted}; the mission has {max(0, len(known) - 1)}")
    yield from go_to_item(flight, run, wanted)
    return SUCCEEDED


def go_to_item(flight: ProcedureContext, run: ProcedureRun, wanted: int) -> Part:
    """Make an item the current one, by its number from 1, until MISSION_CURRENT shows it."""
    poll, flight.plan.sent_to = Poll(flight, run, "MISSION_CURRENT"), wanted
    run.waits_for = f"the vehicle to report that item {wanted} is its current one"
    for _ in range(SET_CURRENT_TRIES):
        flight.send(dialect.MAVLink_mission_set_current_message(*flight.addressee, wanted))
        until = flight.now + flight.wait(*TRY_EVERY)
        while flight.now <= until:
            poll()
            yield
            message = flight.message
            match message:
                case dialect.MAVLink_mission_current_message() if message.seq == wanted:
                    return
                case dialect.MAVLink_mission_ack_message() if message.type != dialect.MAV_MISSION_ACCEPTED and ours(
                    flight, message
                ):
                    raise Ended("refused", f"the vehicle refused item {wanted}: {RESULTS.get(message.type)}")
    raise Ended("failed", f"the vehicle did not go to item {wanted}; does its mission have that many items?")


def flown_now(flight: ProcedureContext) -> str:
    """Return that the vehicle flies its mission, which must not change meanwhile, for people; empty = it does not."""
    vehicle = flight.vehicle
    if flight.plan.flown_by:
        return f"{flight.plan.flown_by} is flying the vehicle's mission; cancel it first"
    if vehicle.armed and vehicle.mode == vehicle.modes.auto:
        return f"the vehicle is flying its mission ({vehicle.mode_name}); set another mode first"
    return ""


def report_items(flight: ProcedureContext) -> None:
    """Report the items as readings, after withdrawing those of an older mission."""
    items = flight.plan.items or ()
    flight.report(Reading("MISSION", None))
    for seq, item in enumerate(items[1:], 1):
        place = item.place
        fields = {
            "seq": seq, "command": item.name, "latitude": place.latitude, "longitude": place.longitude,
            "altitude": place.altitude, "frame": item.frame, "count": len(items) - 1,
        }  # fmt: skip
        flight.report(Reading("MISSION", fields | {f"param{n}": one for n, one in enumerate(item.parameters, 1)}))
    waypoints = [
        {
            "frame": item.frame, "command": item.command, "is_current": False, "autocontinue": bool(item.autocontinue),
            **{f"param{n}": one for n, one in enumerate(item.parameters, 1)},
            "x_lat": item.x / 1e7, "y_long": item.y / 1e7, "z_alt": item.z,
        }
        for item in items
    ]  # fmt: skip
    flight.report(Reading("MISSION_LIST", {"count": max(0, len(items) - 1), "waypoints": waypoints}))


def outside(flight: ProcedureContext, items: tuple[Item, ...]) -> str:
    """Return which item breaks which limit of the mission file, for people; empty = none."""
    home, limits = flight.altitude_of_home() or 0.0, flight.limits
    for seq, item in enumerate(items, 1):
        broken = item.outside(flight.too_high, flight.too_far, home)
        if limits.altitude is not None and item.flown and item.above_terrain:
            broken = "an altitude above terrain cannot be compared with the mission's limit, which is above home"
        if item.command == dialect.MAV_CMD_DO_SET_HOME and flight.limited:
            broken = MOVES_HOME
        if broken:
            return f"item {seq} of the mission: {broken}"
    return ""


def _home(flight: ProcedureContext) -> Item:
    """Return the item 0, home: the vehicle keeps its own."""
    home = flight.vehicle.home or Place(0.0, 0.0, 0.0)
    x, y = round(home.latitude * 1e7), round(home.longitude * 1e7)
    return Item(dialect.MAV_CMD_NAV_WAYPOINT, AMSL, x=x, y=y, z=home.altitude)


@contextmanager
def mission_protocol(flight: ProcedureContext, run: ProcedureRun, kind: int = MISSION) -> Iterator[None]:
    """Reserve the mission protocol for one action on a list (MAV_MISSION_TYPE), until its end.

    Raises Ended while another one has it.
    """
    plan = flight.plan
    if plan.busy:
        raise Ended("refused", f"busy: {plan.busy} is exchanging the mission with the vehicle")
    plan.busy = run.name
    try:
        yield
    finally:
        plan.busy = ""
        if run.leaves:  # an upload that is broken off would keep others waiting
            cancelled = dialect.MAV_MISSION_OPERATION_CANCELLED
            flight.send(dialect.MAVLink_mission_ack_message(*flight.addressee, cancelled, kind))
