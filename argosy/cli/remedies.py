"""Remedies for the health notes of daemons, and where to find their logs."""

from __future__ import annotations

from typing import Literal

from schemas.mission.model import Mission
from schemas.wire.records import Note

REMEDIES = {
    "autopilot_unknown": "is this the right vehicle at the robot's `link` and `sysid`? Only ArduPilot and PX4 "
    "are flown (docs/guides/mavlink.md)",
    "failsafe_none": "if the vehicle's own ground-station failsafe is to watch this bridge: "
    "`failsafe: {gcs: bridge}` at the robot in the mission, else `human` or `none` (docs/guides/mavlink.md)",
    "failsafe_off": "set that parameter on the vehicle, or set `failsafe: {gcs: none}` in the mission",
    "failsafe_unknown": "is it an ArduPilot or a PX4? `failsafe: {gcs: none}` for vehicles that have none",
    "foreign_packets": "who speaks there? Sign the vehicle's link (docs/guides/mavlink.md, signing)",
    "link_down": "see `vehicles`: cable, device, baud rate or address of the robot's `link` in the mission",
    "link_renewed": "was its commd stopped, or without processor? Nothing to do (docs/guides/boards.md, restarts)",
    "mail_went_back": "was a backup restored? Mail that was taken since then is lost: its senders are to send it again "
    "(docs/guides/mail.md)",
    "no_heartbeat": "see `vehicles`: is it switched on, is this its `sysid` and `link` in the mission?",
    "operator_order": "when the agents may act again: `argosy stop release`",
    "percepts_unreadable": "the percept's `args` in the manifest are to name what the robot sends "
    "(docs/reference/manifests.md)",
    "robot_unattended": "`argosy why AGENT` shows what its program did last; `argosy stop land|rtl` acts now",
    "session_id_forged": "whose keys are these, and who has a copy? `argosy keys revoke` (docs/guides/security.md)",
    "texts_missing": "`failsafe: {gcs: bridge}` if this bridge is the only station; otherwise read them in the ground "
    "station (docs/guides/mavlink.md, Autopilots)",
    "two_vehicles": "give each its own MAV_SYSID; if there is only one, another sender forges it: sign its link",
}
"""Remedy of each note, by its code."""
GRAVE = frozenset({"autopilot_unknown", "robot_unattended", "session_id_forged"})
"""Codes of notes that are errors: a robot cannot fly, flies without an agent, or is attacked."""


def level_of(note: Note) -> Literal["warning", "error"]:
    """Return the level of a health note."""
    return "error" if note.code in GRAVE else "warning"


def logs_of(daemon: str, mission: Mission, board: str) -> str:
    """Return how to find a daemon's logs, as text."""
    unit, whole = f"{daemon}@{mission.name}", f"board@{mission.name}"
    units = f"on {board}: `systemctl status {unit}` and `journalctl -u {unit} -n 50` (of one process: `{whole}`)"
    return _either(mission, "see what it prints", units)


def target_of(mission: Mission, verb: str, board: str) -> str:
    """Return how to `start` all daemons of a board, or show their `status`, as text."""
    units = f"on {board}: `systemctl {verb} argosy-{mission.name}.target`"
    return _either(mission, "see what it prints" if verb == "status" else "start it", units)


def _either(mission: Mission, by_run: str, units: str) -> str:
    """Return the advice for units if the boards have addresses, else both."""
    if any(board.address for board in mission.boards.values()):
        return units
    return f"with `argosy run`: {by_run}; with units, {units}"
