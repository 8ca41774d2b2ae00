"""A manifest as plain data: as TOML text, and changed by paths such as `percepts.altitude.rate`.

`tomli_w` is not used: it writes each element of a list on its own line, 410 lines for `copter` instead of 265.
"""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Mapping
from typing import Any

import msgspec

from schemas.files.findings import did_you_mean
from schemas.files.toml_positions import key_parts
from schemas.files.units import Duration
from schemas.manifest.loader import TABLES
from schemas.manifest.model import Manifest
from schemas.wire.records import ManifestChange

LINE = 110
"""Characters beyond which a list is written with an element a line."""
WHAT = {"percepts": "percept", "actions": "action", "orders": "order"}
"""What an entry of a table is called."""
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+", re.ASCII)
_AS_WRITTEN = frozenset({"fields", "value", "default"})
"""Where a whole number may be meant as one, so that 1.0 stays 1.0; all other figures are of one type."""


def document(manifest: Manifest) -> dict[str, Any]:
    """Return the plain data that a TOML file of this manifest holds: `read_document` makes an equal manifest of it."""
    made: dict[str, Any] = {"robot": _data(manifest.robot)}
    if manifest.orders:
        made["orders"] = dict(manifest.orders)
    if manifest.percepts:
        made["percepts"] = {name: _data(entry) for name, entry in manifest.percepts.items()}
    if manifest.actions:
        made["actions"] = {name: _data(entry) for name, entry in manifest.actions.items()}
    return made


def write_toml(manifest: Manifest) -> str:
    """Return a manifest as the text of a TOML file."""
    return write_document(document(manifest))


def write_document(document: dict[str, Any]) -> str:
    """Return the plain data of a manifest, or of one table of it, as TOML. Entries are tables, the rest is inline."""
    blocks: list[str] = []
    for table in ("robot", "orders"):
        if content := document.get(table):
            blocks.append(_table((table,), content))
    for table in ("percepts", "actions"):
        blocks += [_table((table, name), entry) for name, entry in document.get(table, {}).items()]
    return "\n".join(blocks)


def write_value(value: object) -> str:
    """Return a value in TOML syntax, on one line."""
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        case int() | float():
            return repr(value)
        case list() | tuple():
            return f"[{', '.join(map(write_value, value))}]"
        case dict():
            return f"{{{', '.join(f'{_key(name)} = {write_value(item)}' for name, item in value.items())}}}"
    raise TypeError(f"TOML has no {type(value).__name__}")


def _table(path: tuple[str, ...], content: dict[str, Any]) -> str:
    lines = [f"[{'.'.join(map(_key, path))}]"]
    for name, value in content.items():
        line = f"{_key(name)} = {write_value(value)}"
        if len(line) > LINE and isinstance(value, list):
            line = "\n".join([f"{_key(name)} = [", *(f"  {write_value(item)}," for item in value), "]"])
        lines.append(line)
    return "\n".join(lines) + "\n"


def _key(name: str) -> str:
    return name if _BARE_KEY.fullmatch(name) else write_value(name)


def _data(entry: msgspec.Struct) -> Any:
    return _tidy(msgspec.to_builtins(entry, enc_hook=plain))


def plain(value: object) -> object:
    """Return a duration as people write it, if nothing of it is lost: msgspec's `enc_hook`."""
    if isinstance(value, Duration):
        text = str(value)
        try:
            return text if Duration.read(text) == value else float(value)
        except ValueError:
            return float(value)
    raise NotImplementedError(f"no encoding for {type(value).__name__}")


def _tidy(value: Any) -> Any:
    """The same with whole numbers written as such: `rate = 10`."""
    if isinstance(value, dict):
        return {name: item if name in _AS_WRITTEN else _tidy(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_tidy(item) for item in value]
    return int(value) if isinstance(value, float) and value.is_integer() and abs(value) < 1e15 else value


class BadPath(ValueError):
    """A path that does not exist in the manifest; the text has the reason."""


def changed(document: Mapping[str, Any], change: ManifestChange) -> tuple[dict[str, Any], list[str]]:
    """Return the plain manifest after a change, and what is wrong with the change's paths."""
    made = copy.deepcopy(dict(document))
    problems: list[str] = []
    for path in change.remove:
        try:
            _remove(made, path)
        except BadPath as error:
            problems.append(str(error))
    for path, value in change.set.items():
        try:
            if _holds_nothing(value):
                raise BadPath(f"{path}: expected a value, got null; to remove it, list it under `remove`")
            _set(made, path, value)
        except BadPath as error:
            problems.append(str(error))
    return made, problems


def _holds_nothing(value: object) -> bool:
    """Whether a value is null, or holds one: a manifest has none, and a limit must not go by one."""
    if isinstance(value, dict | list):
        return any(map(_holds_nothing, value.values() if isinstance(value, dict) else value))
    return value is None


def part_of(document: Mapping[str, Any], path: str) -> tuple[tuple[str, ...], Any]:
    """Return the steps of a path and the value there. Raises BadPath."""
    steps = _steps(path)
    return steps, _lead(document, steps, path)


def _set(made: dict[str, Any], path: str, value: object) -> None:
    *way, last = _steps(path)
    if not way:
        raise BadPath(f"{path}: expected the path of an entry or field, such as `percepts.altitude.rate`")
    if way[0] in WHAT:
        made.setdefault(way[0], {})
    if len(way) > 2:  # a table inside an entry that has all its defaults
        _lead(made, way[:2], path)
    holder = _lead(made, way[:-1], path) if len(way) > 2 else None
    if isinstance(holder, dict) and way[-1] not in holder:
        holder[way[-1]] = {}
    place = _lead(made, way, path)
    place[_step_in(place, last, path)] = value


def _remove(made: dict[str, Any], path: str) -> None:
    *way, last = _steps(path)
    place = _lead(made, way, path) if way else None
    if not isinstance(place, dict):
        raise BadPath(f"{path}: expected the path of an entry or field, such as `percepts.altitude.ttl`")
    if last not in place:
        what = WHAT.get(way[0], "field") if len(way) == 1 else "field"
        raise BadPath(f"{path}: there is no such {what}{did_you_mean(last, place)}")
    del place[last]


def _steps(path: str) -> tuple[str, ...]:
    steps = key_parts(path)
    if not steps:
        raise BadPath(f"`{path}`: expected a path such as `percepts.altitude.rate`")
    if steps[0] not in TABLES:
        raise BadPath(f"{path}: there is no such table{did_you_mean(steps[0], TABLES)}")
    return steps


def _lead(made: Any, steps: tuple[str, ...] | list[str], path: str) -> Any:
    """Return the value at the end of the steps."""
    here = made
    for index, step in enumerate(steps):
        at = _step_in(here, step, path)
        try:
            here = here[at]
        except (KeyError, IndexError):
            what = WHAT.get(steps[0], "field") if index == 1 else "field"
            known = here if isinstance(here, dict) else ()
            raise BadPath(
                f"{'.'.join(steps[: index + 1])}: there is no such {what}{did_you_mean(step, known)}"
            ) from None
    return here


def _step_in(here: Any, step: str, path: str) -> Any:
    """Return the key or index that a step means: an element of a list goes by its number, or by its `name`."""
    if isinstance(here, dict):
        return step
    if isinstance(here, list):
        names = [item.get("name") for item in here if isinstance(item, dict)]
        if step in names:
            return next(index for index, item in enumerate(here) if isinstance(item, dict) and item.get("name") == step)
        if step.isdigit() and int(step) < len(here):
            return int(step)
        named = did_you_mean(step, [name for name in names if isinstance(name, str)])
        raise BadPath(f"{path}: the list has no element `{step}`{named or f'; it has {len(here)}'}")
    raise BadPath(f"{path}: `{step}` is below a single value; set that as a whole")
