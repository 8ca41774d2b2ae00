"""Missions as actions: upload, download, start with progress, clear, and the item that is flown next."""

from __future__ import annotations

from collections.abc import Generator

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.asking import Poll, asked_message
from bridged.drivers.mavlink.confirmation import acknowledged, enter
from bridged.drivers.mavlink.flight import SUCCEEDED, Call, Flight, Steps, Task
from bridged.drivers.mavlink.mission_items import AMSL, RELATIVE, Item, read_items
from bridged.drivers.mavlink.mission_transfer import break_off, clear, download, upload
from bridged.drivers.mavlink.procedures import mode_call
from bridged.drivers.mavlink.vehicle import Place
from bridged.drivers.robot import Outcome, Reading
from schemas.manifest import Retry

PROGRESS_EVERY = (1.0, 0.5)
"""Mission and wall seconds between requests for MISSION_CURRENT."""
END_SHOWS = (3.0, 2.0)
"""Mission and wall seconds in which a vehicle that left AUTO by itself tells that its mission is over."""
BEGINS_WITHIN = (20.0, 3.0)
"""Mission and wall seconds in which a vehicle on the ground must take off for its mission."""
SET_CURRENT_TRIES = 4
COMPLETE = dialect.MISSION_STATE_COMPLETE
START = Retry(times=2)


def upload_mission(flight: Flight, task: Task, call: Call) -> Steps:
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
    if broken := _outside(flight, items):
        return Outcome("refused", broken)
    with _Speaking(flight, task) as busy:
        if busy:
            return Outcome("refused", busy)
        failure = yield from upload(flight, task, (_home(flight), *items))
        if failure is not None:
            return failure
        _tell(flight)
    return SUCCEEDED


def download_mission(flight: Flight, task: Task, call: Call) -> Steps:
    """`mission_download`: every item was told; they become readings of MISSION and MISSION_LIST."""
    with _Speaking(flight, task) as busy:
        if busy:
            return Outcome("refused", busy)
        failure = yield from _learn(flight, task)
        return failure or SUCCEEDED


def clear_mission(flight: Flight, task: Task, call: Call) -> Steps:
    """`mission_clear`: the vehicle counts no items but home."""
    with _Speaking(flight, task) as busy:
        if busy:
            return Outcome("refused", busy)
        failure = yield from clear(flight, task)
        if failure is not None:
            return failure
        flight.plan.items, flight.plan.broken = (_home(flight),), ""
        _tell(flight)
    return SUCCEEDED


def set_current(flight: Flight, task: Task, call: Call) -> Steps:
    """`mission_set_current`: MISSION_CURRENT shows the item."""
    wanted = call.arguments["seq"]
    identity = flight.commands.identity
    task.waits_for = f"the vehicle to tell that item {wanted} is its current one"
    for _ in range(SET_CURRENT_TRIES):
        flight.send(dialect.MAVLink_mission_set_current_message(identity.vehicle, identity.autopilot, int(str(wanted))))
        shown = yield from asked_message(flight, task, "MISSION_CURRENT", (1.0, 1.0), lambda one: one.seq == wanted)
        if shown is not None:
            return SUCCEEDED
    return Outcome("failed", f"the vehicle did not go to item {wanted}; has its mission so many?")


def start_mission(flight: Flight, task: Task, call: Call) -> Steps:
    """`mission_start`: AUTO, then every item to the last; on the ground a mission begins with a takeoff."""
    vehicle, modes = flight.vehicle, flight.vehicle.modes
    if flight.plan.broken:
        return Outcome("refused", flight.plan.broken)
    if not vehicle.armed:
        return Outcome("refused", f"a mission is started armed; {flight.state_in_words()}")
    if flight.plan.items is None:
        with _Speaking(flight, task) as busy:
            failure = Outcome("refused", busy) if busy else (yield from _learn(flight, task))
        if failure is not None:
            return failure
    items = flight.plan.items or ()
    last = max((seq for seq, item in enumerate(items) if seq and item.flown), default=0)
    if not last:
        return Outcome("refused", "the vehicle has no mission; upload one")
    if broken := _outside(flight, items[1:]):
        return Outcome("refused", broken)
    grounded = not vehicle.aloft or modes.ground
    if vehicle.mode != modes.auto:
        failure = yield from enter(flight, task, mode_call(modes.auto), modes.auto)
        if failure is not None:
            return failure
    if grounded:
        refusal = yield from _begin(flight, task)
        if refusal is not None:
            return refusal
    return (yield from _fly(flight, task, items, last, grounded=grounded and not modes.ground))


def _begin(flight: Flight, task: Task) -> Generator[None, None, Outcome | None]:
    command = flight.submit(task, dialect.MAV_CMD_MISSION_START, (0.0,) * 7, START)
    return (yield from acknowledged(flight, task, command, lambda: flight.vehicle.aloft and not _ground(flight)))


def _fly(flight: Flight, task: Task, items: tuple[Item, ...], last: int, *, grounded: bool) -> Steps:
    """Watch the mission until it is over; the vehicle's own messages tell how far it is."""
    vehicle, asked = flight.vehicle, flight.now
    poll, reached, current = Poll(flight, task, "MISSION_CURRENT", PROGRESS_EVERY), 0, 0
    left_at, patience = None, flight.now + flight.wait(*BEGINS_WITHIN)
    while True:
        poll()
        message = flight.message
        match message:
            case dialect.MAVLink_mission_item_reached_message():
                reached = max(reached, message.seq)
            case dialect.MAVLink_mission_current_message():
                current = max(current, message.seq)
                if message.mission_state == COMPLETE and flight.now - asked > flight.wait(*PROGRESS_EVERY):
                    reached = last
        if reached >= last:
            flight.expect_mode(vehicle.modes.after_mission)
            return SUCCEEDED
        _progress(flight, task, items, max(current, 1), last, reached)
        if not vehicle.armed or vehicle.mode != vehicle.modes.auto:
            left_at = flight.now if left_at is None else left_at
            if not vehicle.armed and items[last].ends_on_ground and current >= last:
                return SUCCEEDED
            if flight.now - left_at > flight.wait(*END_SHOWS):
                return _broken_off(flight, reached, last, asked)
        else:
            left_at = None
        if grounded and vehicle.aloft:
            grounded = False
        if grounded and flight.now > patience:
            said = "the mission was started, but the vehicle did not leave the ground; does it begin with a takeoff?"
            return Outcome("failed", flight.with_texts(said, asked))
        yield


def _progress(flight: Flight, task: Task, items: tuple[Item, ...], current: int, last: int, reached: int) -> None:
    task.feedback = {"item": float(current), "items": float(last), "reached": float(reached)}
    where = flight.vehicle.position
    if where is not None:
        task.feedback["altitude"] = round(where.altitude, 2)
        if current < len(items) and items[current].placed:
            task.feedback["distance"] = round(where.distance(items[current].place), 2)
    task.waits_for = f"the end of the mission; it is at item {current} of {last}"


def _broken_off(flight: Flight, reached: int, last: int, asked: float) -> Outcome:
    vehicle = flight.vehicle
    how = (
        f"the mode became {vehicle.mode_name}, which nobody here asked for (pilot, ground station or failsafe)"
        if vehicle.armed
        else "the vehicle disarmed"
    )
    return Outcome(
        "failed", flight.with_texts(f"{how} before the end of the mission (item {reached} of {last})", asked)
    )


def _learn(flight: Flight, task: Task) -> Generator[None, None, Outcome | None]:
    held = yield from download(flight, task)
    if isinstance(held, Outcome):
        return held
    flight.plan.items, flight.plan.broken = held, ""
    _tell(flight)
    return None


def _tell(flight: Flight) -> None:
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


def _outside(flight: Flight, items: tuple[Item, ...]) -> str:
    """Which item breaks which limit of the mission file, in words; empty = none."""
    home = flight.altitude_of_home() or 0.0
    for seq, item in enumerate(items, 1):
        if broken := item.outside(flight.too_high, flight.too_far, home):
            return f"item {seq} of the mission: {broken}"
    return ""


def _home(flight: Flight) -> Item:
    """Item 0 is home: the vehicle keeps its own, whatever is sent."""
    home = flight.vehicle.home or Place(0.0, 0.0, 0.0)
    x, y = round(home.latitude * 1e7), round(home.longitude * 1e7)
    return Item(dialect.MAV_CMD_NAV_WAYPOINT, AMSL, x=x, y=y, z=home.altitude)


def _ground(flight: Flight) -> bool:
    return flight.vehicle.modes.ground


class _Speaking:
    """Speaks the mission protocol for one action; the next one is told who does. Ends also when the action is ended."""

    def __init__(self, flight: Flight, task: Task) -> None:
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
