"""Missions as actions: upload, download, clear, and the item that is flown next; `mission_flight` flies them."""

from __future__ import annotations

from collections.abc import Generator

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Outcome, Reading
from bridged.drivers.mavlink.actions.context import SUCCEEDED, Call, ProcedureContext, Steps, Task
from bridged.drivers.mavlink.actions.mission_items import AMSL, RELATIVE, Item, read_items
from bridged.drivers.mavlink.actions.mission_transfer import (
    RESULTS,
    TRY_EVERY,
    break_off,
    clear,
    download,
    ours,
    upload,
)
from bridged.drivers.mavlink.actions.requests import Poll
from bridged.drivers.mavlink.vehicle.state import Place

SET_CURRENT_TRIES = 4
MOVES_HOME = "it moves home, from where the mission's limits are measured"


def upload_mission(flight: ProcedureContext, task: Task, call: Call) -> Steps:
    """`mission_upload`: every item within the limits, acknowledged, and as many counted back.

    With `home_first` the first item stands for home, as in ArduPilot's own numbering: the vehicle keeps its own.
    """
    said = call.arguments["items"]
    if call.arguments.get("home_first") is True and isinstance(said, list):
        said = said[1:]
    try:
        items = read_items(said, AMSL if call.frame == dialect.MAV_FRAME_GLOBAL_INT else RELATIVE)
    except ValueError as error:
        return Outcome("refused", str(error))
    if flown := _flown_now(flight):
        return Outcome("refused", flown)
    if broken := outside(flight, items):
        return Outcome("refused", broken, "limits")
    with Speaking(flight, task) as busy:
        if busy:
            return Outcome("refused", busy)
        failure = yield from upload(flight, task, (_home(flight), *items))
        if failure is not None:
            return failure
        tell_items(flight)
    return SUCCEEDED


def download_mission(flight: ProcedureContext, task: Task, call: Call) -> Steps:
    """`mission_download`: every item was told; they become readings of MISSION and MISSION_LIST."""
    with Speaking(flight, task) as busy:
        if busy:
            return Outcome("refused", busy)
        failure = yield from _learn(flight, task)
        return failure or SUCCEEDED


def clear_mission(flight: ProcedureContext, task: Task, call: Call) -> Steps:
    """`mission_clear`: the vehicle counts no items but home."""
    if flown := _flown_now(flight):
        return Outcome("refused", flown)
    with Speaking(flight, task) as busy:
        if busy:
            return Outcome("refused", busy)
        failure = yield from clear(flight, task)
        if failure is not None:
            return failure
        flight.plan.items, flight.plan.broken = (_home(flight),), ""
        tell_items(flight)
    return SUCCEEDED


def set_current(flight: ProcedureContext, task: Task, call: Call) -> Steps:
    """`mission_set_current`: MISSION_CURRENT shows the item."""
    wanted = call.arguments["seq"]
    if not isinstance(wanted, int):
        return Outcome("refused", f"an item is a whole number, got {wanted!r}")
    known = flight.plan.items
    if known is not None and not 0 < wanted < len(known):
        return Outcome("refused", f"no item {wanted}; the mission has {max(0, len(known) - 1)}")
    failure = yield from go_to_item(flight, task, wanted)
    return failure or SUCCEEDED


def go_to_item(flight: ProcedureContext, task: Task, wanted: int) -> Generator[None, None, Outcome | None]:
    identity, poll = flight.commands.identity, Poll(flight, task, "MISSION_CURRENT")
    task.waits_for = f"the vehicle to tell that item {wanted} is its current one"
    for _ in range(SET_CURRENT_TRIES):
        flight.send(dialect.MAVLink_mission_set_current_message(identity.vehicle, identity.autopilot, wanted))
        until = flight.now + flight.wait(*TRY_EVERY)
        while flight.now <= until:
            poll()
            yield
            message = flight.message
            match message:
                case dialect.MAVLink_mission_current_message() if message.seq == wanted:
                    return None
                case dialect.MAVLink_mission_ack_message() if message.type != dialect.MAV_MISSION_ACCEPTED and ours(
                    flight, message
                ):
                    return Outcome("refused", f"the vehicle refused item {wanted}: {RESULTS.get(message.type)}")
    return Outcome("failed", f"the vehicle did not go to item {wanted}; has its mission so many?")


def _learn(flight: ProcedureContext, task: Task) -> Generator[None, None, Outcome | None]:
    held = yield from download(flight, task)
    if isinstance(held, Outcome):
        return held
    flight.plan.items, flight.plan.broken = held, ""
    tell_items(flight)
    return None


def _flown_now(flight: ProcedureContext) -> str:
    """In words, that the vehicle flies its mission: what it stores must not change under it. Empty = it does not."""
    vehicle = flight.vehicle
    if flight.plan.flown_by:
        return f"{flight.plan.flown_by} is flying the vehicle's mission; cancel it first"
    if vehicle.armed and vehicle.mode == vehicle.modes.auto:
        return f"the vehicle is flying its mission ({vehicle.mode_name}); set another mode first"
    return ""


def tell_items(flight: ProcedureContext) -> None:
    """The items as readings: those of an older mission go first."""
    items = flight.plan.items or ()
    flight.tell(Reading("MISSION", None))
    for seq, item in enumerate(items[1:], 1):
        place = item.place
        fields = {
            "seq": seq, "command": item.name, "latitude": place.latitude, "longitude": place.longitude,
            "altitude": place.altitude, "frame": item.frame, "count": len(items) - 1,
        }  # fmt: skip
        flight.tell(Reading("MISSION", fields | {f"param{n}": one for n, one in enumerate(item.parameters, 1)}))
    waypoints = [
        {
            "frame": item.frame, "command": item.command, "is_current": False, "autocontinue": bool(item.autocontinue),
            **{f"param{n}": one for n, one in enumerate(item.parameters, 1)},
            "x_lat": item.x / 1e7, "y_long": item.y / 1e7, "z_alt": item.z,
        }
        for item in items
    ]  # fmt: skip
    flight.tell(Reading("MISSION_LIST", {"count": max(0, len(items) - 1), "waypoints": waypoints}))


def outside(flight: ProcedureContext, items: tuple[Item, ...]) -> str:
    """Which item breaks which limit of the mission file, in words; empty = none."""
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
    """Item 0 is home: the vehicle keeps its own, whatever is sent."""
    home = flight.vehicle.home or Place(0.0, 0.0, 0.0)
    x, y = round(home.latitude * 1e7), round(home.longitude * 1e7)
    return Item(dialect.MAV_CMD_NAV_WAYPOINT, AMSL, x=x, y=y, z=home.altitude)


class Speaking:
    """Speaks the mission protocol for one action; the next one is told who does. Ends also when the action is ended."""

    def __init__(self, flight: ProcedureContext, task: Task) -> None:
        self._flight, self._task = flight, task
        self._mine = False

    def __enter__(self) -> str:
        plan = self._flight.plan
        if plan.busy:
            return f"busy: {plan.busy} is exchanging the mission with the vehicle"
        plan.busy, self._mine = self._task.name, True
        return ""

    def __exit__(self, *_: object) -> None:
        if self._mine:
            self._flight.plan.busy = ""
        if self._task.leaves:
            break_off(self._flight)
