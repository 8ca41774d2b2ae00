"""Apply a change to a manifest, by paths such as `percepts.altitude.rate`."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

from schemas.files.findings import did_you_mean
from schemas.files.toml_positions import key_parts
from schemas.manifest.loader import TABLES
from schemas.wire.records import ManifestChange

WHAT = {"percepts": "percept", "actions": "action", "orders": "order"}


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
