"""The mission protocol from our side (MAVLink devguide, mission.md): items sent, read back and cleared.

The vehicle leads an upload: it asks for each item, and asks again. Everything is bounded, and what an upload that did
not end has left is said.
"""

from __future__ import annotations

from collections.abc import Generator

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Outcome
from bridged.drivers.mavlink.actions.context import ProcedureContext, Task
from bridged.drivers.mavlink.actions.mission_items import MAX_ITEMS, Item, item_of
from bridged.drivers.mavlink.actions.requests import for_us, next_message

TRIES = 6
TRY_EVERY = (1.0, 1.0)
"""Mission and wall seconds before we ask again."""
VEHICLE_GIVES_UP = (9.0, 6.0)
"""Mission and wall seconds of silence after which an upload is over: the vehicle asks again every second, for 8 s."""
RESULTS = {
    dialect.MAV_MISSION_ERROR: "it failed",
    dialect.MAV_MISSION_UNSUPPORTED_FRAME: "the frame of an item is not supported",
    dialect.MAV_MISSION_UNSUPPORTED: "a command is not supported",
    dialect.MAV_MISSION_NO_SPACE: "there is no space for so many items",
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
"""MISSION_ACK.type in words."""


def upload(flight: ProcedureContext, task: Task, items: tuple[Item, ...]) -> Generator[None, None, Outcome | None]:
    """Send the items; the first is home. Returns the failure, None if the vehicle holds as many as were sent.

    An acknowledgement that is lost proves nothing: then the items are read back and compared.
    """
    count, sent, quiet_since, tries = len(items), 0, flight.now, 0
    again_at, plan = flight.now, flight.plan
    plan.items = None
    while True:
        if not sent and flight.now >= again_at:
            if tries >= TRIES:
                task.leaves = ""
                return Outcome("failed", f"the vehicle did not ask for the mission, told of it {TRIES} times")
            tries, again_at = tries + 1, flight.now + flight.wait(*TRY_EVERY)
            flight.send(dialect.MAVLink_mission_count_message(*_peer(flight), count))
        task.feedback = {"item": float(max(0, sent - 1)), "items": float(count - 1)}
        task.waits_for = f"the vehicle to take item {sent} of {count}"
        yield
        message = flight.message
        if message is not None and message.get_type().startswith("MISSION_") and ours(flight, message):
            match message.get_type():
                case "MISSION_REQUEST" | "MISSION_REQUEST_INT" if message.seq < count:
                    quiet_since, sent = flight.now, max(sent, message.seq + 1)
                    task.leaves = plan.broken = _broken(sent, count)
                    flight.send(_packed(flight, message.seq, items[message.seq]))
                case "MISSION_ACK" if message.type == dialect.MAV_MISSION_ACCEPTED:
                    if sent == count:  # any other is a late one, of an exchange before
                        break
                case "MISSION_ACK" if message.type != dialect.MAV_MISSION_INVALID_SEQUENCE or not sent:
                    task.leaves = ""
                    left = f"; {plan.broken}" if sent else ""
                    return Outcome("refused", f"the vehicle refused the mission: {_result(message)}{left}")
        if sent and flight.now - quiet_since > flight.wait(*VEHICLE_GIVES_UP):
            if sent < count:
                task.leaves = ""
                return Outcome("failed", f"the vehicle fell silent during the upload; {plan.broken}")
            held = yield from download(flight, task)
            if isinstance(held, tuple) and same_items(held, items):
                break
            return Outcome("failed", f"the vehicle did not acknowledge the mission; {plan.broken}")
    task.leaves = ""
    held_count = yield from count_items(flight, task)
    uncounted = flight.vehicle.home is None  # home counts as an item once the vehicle has one
    if held_count != count and not (uncounted and held_count == count - 1):
        said = "does not tell how many items it holds" if held_count is None else f"holds {held_count} items with home"
        return Outcome("failed", f"the mission of {count} items with home was acknowledged, but the vehicle {said}")
    plan.items, plan.broken = items, ""
    return None


def download(flight: ProcedureContext, task: Task) -> Generator[None, None, tuple[Item, ...] | Outcome]:
    """Read the vehicle's mission. Returns its items, home first, or the failure."""
    count = yield from count_items(flight, task)
    if count is None:
        return Outcome("failed", f"the vehicle did not tell its mission, asked {TRIES} times")
    if count > MAX_ITEMS + 1:
        return Outcome("failed", f"the vehicle tells of {count} items; {MAX_ITEMS} are read at most")
    items: list[Item] = []
    for seq in range(count):
        task.feedback = {"item": float(seq), "items": float(max(0, count - 1))}
        task.waits_for = f"item {seq} of {count} from the vehicle"
        item = yield from _read(flight, seq)
        if isinstance(item, Outcome):
            return item
        items.append(item)
    flight.send(dialect.MAVLink_mission_ack_message(*_peer(flight), dialect.MAV_MISSION_ACCEPTED))
    return tuple(items)


def count_items(flight: ProcedureContext, task: Task) -> Generator[None, None, int | None]:
    """Ask how many items the vehicle holds, home counted. Returns None if it does not tell."""
    task.waits_for = "the vehicle to tell how many items it holds"
    for _ in range(TRIES):
        flight.send(dialect.MAVLink_mission_request_list_message(*_peer(flight)))
        message = yield from next_message(flight, "MISSION_COUNT", TRY_EVERY, lambda one: ours(flight, one))
        if message is not None:
            return int(message.count)
    return None


def clear(flight: ProcedureContext, task: Task) -> Generator[None, None, Outcome | None]:
    """Clear the vehicle's mission. Returns the failure, None if it holds none but home."""
    for _ in range(TRIES):
        flight.send(dialect.MAVLink_mission_clear_all_message(*_peer(flight)))
        task.waits_for = "the vehicle to clear its mission"
        message = yield from next_message(flight, "MISSION_ACK", TRY_EVERY, lambda one: ours(flight, one))
        if message is not None and message.type != dialect.MAV_MISSION_ACCEPTED:
            return Outcome("refused", f"the vehicle refused to clear its mission: {_result(message)}")
        held = yield from count_items(flight, task)
        if held is not None and held <= 1:
            return None
    return Outcome("failed", "the vehicle still holds a mission, or does not tell")


def break_off(flight: ProcedureContext) -> None:
    """Tell the vehicle that an upload goes on no more: it would keep others waiting."""
    flight.send(dialect.MAVLink_mission_ack_message(*_peer(flight), dialect.MAV_MISSION_OPERATION_CANCELLED))


def _read(flight: ProcedureContext, seq: int) -> Generator[None, None, Item | Outcome]:
    for _ in range(TRIES):
        flight.send(dialect.MAVLink_mission_request_int_message(*_peer(flight), seq))
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
                    return Outcome("failed", f"the vehicle did not tell item {seq}: {_result(message)}")
    return Outcome("failed", f"the vehicle did not tell item {seq} of its mission, asked {TRIES} times")


def _broken(sent: int, count: int) -> str:
    """ArduPilot stores items as they come: what it held before is not what it holds now."""
    return (
        f"the upload was broken off at item {sent - 1} of {count - 1}: "
        "what mission the vehicle holds now is not known; upload again or clear it"
    )


def _packed(flight: ProcedureContext, seq: int, item: Item) -> dialect.MAVLink_message:
    return dialect.MAVLink_mission_item_int_message(
        *_peer(flight), seq, item.frame, item.command, 0, item.autocontinue, *item.parameters, item.x, item.y, item.z
    )


def _peer(flight: ProcedureContext) -> tuple[int, int]:
    identity = flight.commands.identity
    return identity.vehicle, identity.autopilot


def ours(flight: ProcedureContext, message: dialect.MAVLink_message) -> bool:
    """Of the mission's list (not of the fence's or the rally points'), and for us."""
    return hasattr(message, "target_system") and for_us(flight, message) and getattr(message, "mission_type", 0) == 0


def _result(message: dialect.MAVLink_message) -> str:
    return RESULTS.get(message.type, f"result {message.type}")


def same_items(held: tuple[Item, ...], items: tuple[Item, ...]) -> bool:
    """Whether a vehicle that holds the ones holds the others; home is its own business."""
    return len(held) == len(items) and all(one.same(other) for one, other in zip(held[1:], items[1:], strict=True))
