"""The status of a fleet as lines of `key=value` and as JSON: for pipes, and for programs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import msgspec

from argosy.fleet_model.fleet_status import Row
from schemas.humanize import printable

ANY_FLEET = "any"
"""What stands for the fleet where all on the router are shown."""


def line(row: Row) -> str:
    """Return a daemon in one line: standing, daemon, name, then what it tells as `key=value`."""
    told: dict[str, object] = {"board": row.board}
    if (health := row.now) is not None:
        told |= {
            "version": health.version,
            "uptime": f"{health.uptime:.0f}",
            "age": f"{row.age:.1f}",
            "lag": f"{health.lag:.3f}",
            "drops": health.drops,
            "bad_input": health.bad_input,
            "restarts": "" if health.restarts is None else health.restarts,
            "errors": health.errors,
            "last_error": _quoted(health.last_error),
        }
        if health.paused:
            told["paused"] = "yes"
    if not row.in_mission:
        told["in_mission"] = "no"
    words = " ".join(f"{name}={value}" for name, value in told.items() if value != "")
    notes = "".join(f" note={_quoted(note.text)}" for note in row.notes)
    return printable(f"{row.standing} {row.daemon} {row.title} {words}{notes}".rstrip())


def summary(fleet: str, rows: Sequence[Row]) -> str:
    """Return in one line whether all is well."""
    ill = [row for row in rows if not row.well]
    whose = f"fleet {fleet}" if fleet != ANY_FLEET else "all fleets"
    there = f"{whose}: {len(rows) - len(ill)} of {len(rows)} daemons are up"
    if not rows:
        return f"{whose}: nobody is there"
    if not ill:
        return there if fleet != ANY_FLEET else f"{there}; who else should be, a mission says: `argosy status MISSION`"
    standings = dict.fromkeys(row.standing for row in ill)
    kinds = (f"{one}: {', '.join(f'{r.daemon} {r.title}' for r in ill if r.standing == one)}" for one in standings)
    return printable(f"{there}; {'; '.join(kinds)}")


def to_json(fleet: str, rows: Sequence[Row], well: bool) -> dict[str, Any]:
    """Return the status as JSON has it."""
    return {"fleet": fleet, "well": well, "daemons": [_row_to_json(row) for row in rows]}


def _row_to_json(row: Row) -> dict[str, Any]:
    told: dict[str, Any] = {
        **({"fleet": row.fleet} if row.fleet else {}),
        "name": row.name,
        "daemon": row.daemon,
        "board": row.board,
        "standing": row.standing,
        "well": row.well,
        "in_mission": row.in_mission,
        "notes": msgspec.to_builtins(row.notes),
    }
    if row.now is not None:
        health = row.now
        names = ("version", "pid", "uptime", "cpu", "lag", "drops", "bad_input", "restarts", "errors")
        told |= {name: getattr(health, name) for name in (*names, "last_error", "last_error_age", "counters")}
        if row.daemon == "bridged":
            told |= {"paused": health.paused, "ordered": health.ordered}
        told["age"] = None if row.age is None else round(row.age, 1)
    return told


def _quoted(text: str) -> str:
    return json.dumps(printable(text), ensure_ascii=False) if text else ""
