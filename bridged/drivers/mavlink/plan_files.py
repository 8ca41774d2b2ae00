"""Plan files of ground stations: QGroundControl's `.plan` (JSON) and the list of waypoints `QGC WPL 110`.

Both are read into the items of a mission without home, and written from a vehicle's items with home. What cannot be
understood is refused by its place; nothing is left out in silence. Source of the formats: the developer guides of
QGroundControl (file formats, Plan) and MAVLink (file formats, Mission Plain-Text).
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.actions.mission_items import FRAMES, LAST_NAV, MAX_ITEMS, RELATIVE, Item
from schemas.files.text_files import read_bounded
from schemas.files.validation import FIRST_USE

QUOTES = "'\""
MAX_BYTES = 2 * 2**20
"""A larger file is refused unread: 700 items of a survey with its lines have a few hundred kB."""
SUFFIXES = (".plan", ".waypoints")
WPL = "QGC WPL 110"
"""First line of a list of waypoints; item 0 is home."""
COLUMNS = 12
MAX_NUMBER = 3.4e38
"""Of 32 bits."""
MAX_ALTITUDE = MAX_RADIUS = 1e5
"""Metres; an altitude up or down."""
MAX_TEXT = 60
"""Characters of a wrong value that an error shows."""
MISSION_FRAME = dialect.MAV_FRAME_MISSION
"""Of items without a place."""
_NO_PLACE = frozenset({
    dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH, dialect.MAV_CMD_NAV_DELAY, dialect.MAV_CMD_NAV_GUIDED_ENABLE,
})  # fmt: skip
"""Commands that are flown and have neither a place nor an altitude."""


class BadPlan(ValueError):
    """A plan file that cannot be used: where in it, what was expected, and what it has."""


@dataclass(frozen=True)
class PlanFile:
    """The mission of a plan file, its fence and its rally points."""

    items: tuple[Item, ...]
    """Without home."""
    fence: tuple[Item, ...] = ()
    rally: tuple[Item, ...] = ()
    not_taken: tuple[str, ...] = ()
    """Parts of the file that no list of a vehicle takes, for people."""

    @property
    def remark(self) -> str:
        """Return what is not taken, for people; empty if that is nothing."""
        return f"not taken from the file: {'; '.join(self.not_taken)}" if self.not_taken else ""


def find_plan(folder: Path, name: str) -> Path:
    """Return the plan file that a program or manifest names, in the folder of the mission file or below it.

    Raises BadPlan for a name that leads elsewhere, also by a link, and for one that is no name of a plan file.
    """
    shown = _shown(name)
    if not name or "\0" in name or Path(name).is_absolute() or ".." in Path(name).parts:
        raise BadPlan(f"expected the path of a plan file relative to the mission file, without `..`, got {shown}")
    if Path(name).suffix not in SUFFIXES:
        raise BadPlan(f"expected the name of a plan file, *{' or *'.join(SUFFIXES)}, got {shown}")
    try:
        home, path = folder.resolve(), (folder / name).resolve()
    except (OSError, RuntimeError, ValueError):  # links that lead round, text that is no name of a file
        raise BadPlan(f"{shown} cannot be followed to a file") from None
    if not path.is_relative_to(home):
        raise BadPlan(f"{shown} leads out of the folder of the mission file by a link: put the file itself there")
    return path


def read_plan(path: Path, name: str = "") -> PlanFile:
    """Read a plan file; errors call it `name`. Raises BadPlan."""
    name = name or str(path)
    try:
        content = read_bounded(path, MAX_BYTES)
    except FileNotFoundError:
        raise BadPlan(f"{name}: there is no such file on this machine") from None
    except OSError as error:
        raise BadPlan(f"{name}: {error.strerror}") from None
    try:
        return parse_plan(content.decode("utf-8-sig"))
    except UnicodeDecodeError:
        raise BadPlan(f"{name}: expected UTF-8 text") from None
    except BadPlan as error:
        raise BadPlan(f"{name}: {error}") from None


def parse_plan(content: str) -> PlanFile:
    """Read the text of a plan file of either format. Raises BadPlan."""
    if content.split(maxsplit=2)[:2] == WPL.split()[:2]:
        items = tuple(_items_of_lines(content))
        plan = PlanFile(tuple(_jumping(items, {seq: seq for seq in range(1, len(items) + 1)})))
    elif content.lstrip().startswith("{"):
        plan = _read_json(content)
    else:
        raise BadPlan(f"expected a plan of QGroundControl (JSON), or a list of waypoints that begins with `{WPL}`")
    if not plan.items:
        raise BadPlan("it has no items")
    return plan


# --- QGC WPL 110 -----------------------------------------------------------------------------------------------------


def _items_of_lines(text: str) -> Iterator[Item]:
    """Yield the items of a list of waypoints, without item 0."""
    first, *lines = text.splitlines()
    if first.split() != WPL.split():
        raise BadPlan(f"line 1: expected `{WPL}`, got {_shown(first)}")
    seq = 0
    for number, line in enumerate(lines, 2):
        if not line.strip():
            continue
        try:
            item = _read_line(line, seq)
        except ValueError as error:
            raise BadPlan(f"line {number}: {error}") from None
        if seq:
            yield item
        elif item.command != dialect.MAV_CMD_NAV_WAYPOINT:
            raise BadPlan(f"line {number}: item 0 is home, expected command 16, got {item.command}")
        seq += 1
        if seq > MAX_ITEMS + 1:
            raise BadPlan(f"line {number}: a mission has {MAX_ITEMS} items at most")


def _read_line(line: str, seq: int) -> Item:
    """Read `INDEX CURRENT FRAME COMMAND P1 P2 P3 P4 X Y Z AUTOCONTINUE`. Raises ValueError."""
    fields = line.split()
    if len(fields) != COLUMNS:
        raise ValueError(f"expected {COLUMNS} columns separated by tabs, got {len(fields)}")
    index, frame, command, auto = (_whole(fields[at], what) for at, what in _WHOLE_COLUMNS)
    if index != seq:
        raise ValueError(f"expected item {seq}, got {index}: items are numbered without gaps")
    values = [_decimal(field) for field in fields[4:11]]
    return make_item(command, frame, values, auto)


_WHOLE_COLUMNS = ((0, "the number of the item"), (2, "a frame"), (3, "a command"), (11, "autocontinue"))


def _whole(text: str, what: str) -> int:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not number.is_integer():
        raise ValueError(f"expected {what}, got {_shown(text)}")
    return int(number)


def _decimal(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"expected a number, got {_shown(text)}") from None


# --- QGroundControl's .plan ------------------------------------------------------------------------------------------


Latitude = Annotated[float, Meta(ge=-90, le=90)]
Longitude = Annotated[float, Meta(ge=-180, le=180)]
Parameter = Annotated[float, Meta(ge=-MAX_NUMBER, le=MAX_NUMBER)]


class _Simple(Struct, tag_field="type", tag="SimpleItem", rename="camel"):
    """One item of the mission."""

    command: int
    frame: int
    params: Annotated[list[Parameter | None], Meta(min_length=7, max_length=7)]
    auto_continue: bool = True
    do_jump_id: int | None = None


class _Generated(Struct):
    """The items that the ground station has generated for a complex one."""

    items: list[_Simple] = msgspec.field(default_factory=list, name="Items")


class _Complex(Struct, tag_field="type", tag="ComplexItem", rename="camel"):
    """A survey, a landing, ..."""

    complex_item_type: str = ""
    transect: _Generated = msgspec.field(default_factory=_Generated, name="TransectStyleComplexItem")


class _Mission(Struct):
    version: Literal[2]
    items: list[_Simple | _Complex]


class _Polygon(Struct):
    inclusion: bool
    polygon: Annotated[list[tuple[Latitude, Longitude]], Meta(min_length=3)]


class _Disc(Struct):
    center: tuple[Latitude, Longitude]
    radius: Annotated[float, Meta(ge=0, le=MAX_RADIUS)]


class _Circle(Struct):
    inclusion: bool
    circle: _Disc


class _Fence(Struct, rename="camel"):
    polygons: list[_Polygon] = []
    circles: list[_Circle] = []
    breach_return: Any = None


class _Rally(Struct):
    points: list[tuple[Latitude, Longitude, Annotated[float, Meta(ge=-MAX_ALTITUDE, le=MAX_ALTITUDE)]]] = []


class _Plan(Struct, rename="camel"):
    """The whole file, as far as it is read."""

    file_type: Literal["Plan"]
    version: Literal[1]
    mission: _Mission
    geo_fence: _Fence = msgspec.field(default_factory=_Fence)
    rally_points: _Rally = msgspec.field(default_factory=_Rally)


with FIRST_USE:
    _DECODER = msgspec.json.Decoder(_Plan)


def _read_json(text: str) -> PlanFile:
    try:
        plan = _DECODER.decode(text)
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        raise BadPlan(f"expected a plan of QGroundControl of version 1, its mission of version 2: {error}") from None
    items, jumps = list[Item](), dict[int, int]()
    for place, entry in _simple_items(plan.mission.items):
        numbers = [math.nan if value is None else value for value in entry.params]
        try:
            items.append(make_item(entry.command, entry.frame, numbers, int(entry.auto_continue)))
        except ValueError as error:
            raise BadPlan(f"{place}: {error}") from None
        if entry.do_jump_id is not None:
            jumps.setdefault(entry.do_jump_id, len(items))
        if len(items) > MAX_ITEMS:
            raise BadPlan(f"{place}: a mission has {MAX_ITEMS} items at most")
    return PlanFile(
        tuple(_jumping(items, jumps)),
        tuple(_fence_items(plan.geo_fence)),
        tuple(
            _item(dialect.MAV_CMD_NAV_RALLY_POINT, 0.0, *place, frame=RELATIVE) for place in plan.rally_points.points
        ),
        ("the breach return point",) if plan.geo_fence.breach_return else (),
    )


def _simple_items(entries: Sequence[_Simple | _Complex]) -> Iterator[tuple[str, _Simple]]:
    """Yield the place of each simple item, also of those that were generated for a complex one. Raises BadPlan."""
    for index, entry in enumerate(entries, 1):
        if isinstance(entry, _Simple):
            yield f"item {index}", entry
            continue
        name = f"item {index} ({_shown(entry.complex_item_type).strip(QUOTES)})"
        if not entry.transect.items:
            raise BadPlan(
                f"{name}: the file does not hold the items that the ground station makes of it; "
                "upload it from there, and save what the vehicle holds: argosy plan save ROBOT FILE"
            )
        for inner, generated in enumerate(entry.transect.items, 1):
            yield f"{name}: item {inner}", generated


def _fence_items(fence: _Fence) -> Iterator[Item]:
    """Yield the items of the vehicle's fence: polygons, then circles; each includes or excludes what is in it."""
    for shape in fence.polygons:
        for latitude, longitude in shape.polygon:
            command = (
                dialect.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
                if shape.inclusion
                else dialect.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
            )
            yield _item(command, float(len(shape.polygon)), latitude, longitude)
    for circle in fence.circles:
        command = (
            dialect.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION
            if circle.inclusion
            else dialect.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION
        )
        yield _item(command, circle.circle.radius, *circle.circle.center)


def _item(
    command: int,
    first: float,
    latitude: float,
    longitude: float,
    altitude: float = 0.0,
    frame: int = dialect.MAV_FRAME_GLOBAL_INT,
) -> Item:
    return Item(command, frame, (first, 0.0, 0.0, 0.0), round(latitude * 1e7), round(longitude * 1e7), altitude)


def _jumping(items: Sequence[Item], jumps: Mapping[int, int]) -> Iterator[Item]:
    """Yield the items, DO_JUMP with the number that its target has in the mission; `jumps`: that number by its id."""
    for seq, item in enumerate(items, 1):
        if item.command != dialect.MAV_CMD_DO_JUMP:
            yield item
            continue
        target, times, three, four = item.parameters
        if target not in jumps:
            raise BadPlan(f"item {seq} of the mission: it jumps to item {target:g}, which the file does not have")
        yield replace(item, parameters=(float(jumps[int(target)]), times, three, four))


# --- items of both ---------------------------------------------------------------------------------------------------


def has_place(command: int, frame: int) -> bool:
    """Whether the last three parameters of a command are a place: degrees as 1e-7, and metres."""
    entry = dialect.enums["MAV_CMD"].get(command)
    return frame != MISSION_FRAME and (entry is None or entry.has_location)


def make_item(command: int, frame: int, values: Sequence[float], autocontinue: int) -> Item:
    """Return an item of its 7 parameters, degrees in the fifth and sixth. Raises ValueError.

    NaN leaves a parameter to the vehicle; a place must be known.
    """
    if not 0 <= command <= 65535:
        raise ValueError(f"there is no command {command}")
    if not all(math.isnan(value) or abs(value) <= MAX_NUMBER for value in values):
        raise ValueError("expected numbers that fit into 32 bits")
    one, two, three, four, x, y, z = values
    placed = has_place(command, frame)
    if (placed or command <= int(LAST_NAV)) and command not in _NO_PLACE and frame not in FRAMES:
        raise ValueError(f"frame {frame} is neither above home, above mean sea level nor above terrain")
    if not placed:
        x, y, z = (0.0 if math.isnan(value) else value for value in (x, y, z))
        if max(abs(x), abs(y)) >= 2**31:
            raise ValueError(f"expected whole numbers of 32 bits as fifth and sixth parameter, got {x:g} and {y:g}")
        return Item(command, frame, (one, two, three, four), round(x), round(y), z, autocontinue)
    for name, value, most in (("latitude", x, 90.0), ("longitude", y, 180.0), ("altitude", z, MAX_ALTITUDE)):
        if not abs(value) <= most:
            raise ValueError(f"expected {name}, {-most:g} to {most:g}, got {value:g}")
    return Item(command, frame, (one, two, three, four), round(x * 1e7), round(y * 1e7), z, autocontinue)


def _values(item: Item) -> list[float]:
    """Return the 7 parameters of an item, degrees in the fifth and sixth."""
    scale = 1e7 if has_place(item.command, item.frame) else 1
    return [*item.parameters, item.x / scale, item.y / scale, item.z]


def write_plan(items: Iterable[Item], kind: Literal["plan", "waypoints"], autopilot: int = 3, vehicle: int = 2) -> str:
    """Return the text of a plan file. The first item is home; `autopilot`, `vehicle`: as in the HEARTBEAT."""
    home, *mission = items
    if kind == "waypoints":
        lines = [_line(seq, item) for seq, item in enumerate((home, *mission))]
        return "\n".join([WPL, *lines, ""])
    plan = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "Argosy",
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "rallyPoints": {"points": [], "version": 2},
        "mission": {
            "version": 2,
            "firmwareType": autopilot,
            "vehicleType": vehicle,
            "plannedHomePosition": [home.x / 1e7, home.y / 1e7, home.z],
            "items": [_entry(seq, item) for seq, item in enumerate(mission, 1)],
        },
    }
    return f"{json.dumps(plan, indent=4)}\n"


def _line(seq: int, item: Item) -> str:
    numbers = (f"{value:.8f}" if math.isfinite(value) else "NaN" for value in _values(item))
    # MAVLink's CURRENT marks item 0 in files of ground stations
    return "\t".join(
        [str(seq), str(int(not seq)), str(item.frame), str(item.command), *numbers, str(item.autocontinue)]
    )


def _entry(seq: int, item: Item) -> dict[str, object]:
    return {
        "type": "SimpleItem",
        "autoContinue": bool(item.autocontinue),
        "command": item.command,
        "doJumpId": seq,
        "frame": item.frame,
        "params": [None if math.isnan(value) else value for value in _values(item)],
    }


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= MAX_TEXT else f"{text[: MAX_TEXT - 3]}..."
