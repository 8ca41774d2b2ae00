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
from typing import Any, Literal

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.actions.mission_items import FRAMES, LAST_NAV, MAX_ITEMS, Item
from bridged.drivers.mavlink.plan_fence import MAX_ALTITUDE, fence_items, rally_items
from schemas.files.text_files import read_bounded

QUOTES = "'\""
MAX_BYTES = 2 * 2**20
"""A larger file is refused unread: 700 items of a survey with its lines have a few hundred kB."""
SUFFIXES = (".plan", ".waypoints")
WPL = "QGC WPL 110"
"""First line of a list of waypoints; item 0 is home."""
COLUMNS = 12
MAX_NUMBER = 3.4e38
"""Of 32 bits."""
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


def _read_json(text: str) -> PlanFile:
    try:
        plan = json.loads(text, parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        raise BadPlan(f"expected JSON: {error}") from None
    if plan.get("fileType") != "Plan":
        raise BadPlan(f'expected `"fileType": "Plan"`, {_got(plan.get("fileType"))}')
    if plan.get("version") != 1:
        raise BadPlan(f"expected version 1 of a plan, {_got(plan.get('version'))}")
    mission = _table(plan, "mission")
    if mission.get("version") != 2:
        raise BadPlan(f"mission: expected version 2, {_got(mission.get('version'))}")
    items, jumps = list[Item](), dict[int, int]()
    for place, entry in _simple_items(_list(mission, "items", "mission")):
        try:
            item = _item_of(entry)
        except ValueError as error:
            raise BadPlan(f"{place}: {error}") from None
        items.append(item)
        if isinstance(jump := entry.get("doJumpId"), int):
            jumps.setdefault(jump, len(items))
        if len(items) > MAX_ITEMS:
            raise BadPlan(f"{place}: a mission has {MAX_ITEMS} items at most")
    fence, rally = (part if isinstance(part := plan.get(name), dict) else {} for name in ("geoFence", "rallyPoints"))
    try:
        lists = tuple(fence_items(fence)), tuple(rally_items(rally))
    except ValueError as error:
        raise BadPlan(str(error)) from None
    return PlanFile(
        tuple(_jumping(items, jumps)), *lists, ("the breach return point",) if fence.get("breachReturn") else ()
    )


def _no_constant(name: str) -> None:
    raise ValueError(f"{name} is no number in JSON")


def _simple_items(entries: Sequence[Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield the place and fields of each simple item; complex ones hold those that were generated for them."""
    for index, entry in enumerate(entries, 1):
        match entry:
            case {"type": "SimpleItem"}:
                yield f"item {index}", entry
            case {"type": "ComplexItem"}:
                name = f"item {index} ({_shown(entry.get('complexItemType')).strip(QUOTES)})"
                for inner, generated in enumerate(_generated(name, entry), 1):
                    yield f"{name}: item {inner}", generated
            case _:
                kind = entry.get("type") if isinstance(entry, dict) else entry
                raise BadPlan(f"item {index}: expected a SimpleItem or ComplexItem, {_got(kind)}")


def _generated(name: str, entry: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the items that the ground station has generated for a complex one. Raises BadPlan without any."""
    match entry:
        case {"TransectStyleComplexItem": {"Items": [_, *_]}}:
            items: list[Mapping[str, Any]] = entry["TransectStyleComplexItem"]["Items"]
            if all(isinstance(item, dict) and item.get("type") == "SimpleItem" for item in items):
                return items
            raise BadPlan(f"{name}: expected `Items` of SimpleItems alone")
    raise BadPlan(
        f"{name}: the file does not hold the items that the ground station makes of it; "
        "upload it from there, and save what the vehicle holds: argosy plan save ROBOT FILE"
    )


def _item_of(entry: Mapping[str, Any]) -> Item:
    values = entry.get("params")
    if not isinstance(values, list) or len(values) != 7:
        raise ValueError(f"expected `params`, a list of 7 numbers, {_got(values)}")
    numbers = [math.nan if value is None else _number("params", value) for value in values]
    command, frame = (_index(name, entry.get(name)) for name in ("command", "frame"))
    return make_item(command, frame, numbers, int(entry.get("autoContinue") is not False))


def _index(name: str, value: object) -> int:
    if isinstance(value, int) and not isinstance(value, bool):
        return value
    raise ValueError(f"expected `{name}`, a whole number, {_got(value)}")


def _number(name: str, value: object) -> float:
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= MAX_NUMBER:
        return float(value)
    raise ValueError(f"expected `{name}`: numbers or null, {_got(value)}")


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


def _table(value: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    if isinstance(found := value.get(name), dict):
        return found
    raise BadPlan(f"expected `{name}`, {_got(found)}")


def _list(value: Mapping[str, Any], name: str, where: str) -> list[object]:
    if isinstance(found := value.get(name), list):
        return found
    raise BadPlan(f"{where}: expected `{name}`, a list, {_got(found)}")


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


def _got(value: object) -> str:
    return "there is none" if value is None else f"got {_shown(value)}"


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= MAX_TEXT else f"{text[: MAX_TEXT - 3]}..."
