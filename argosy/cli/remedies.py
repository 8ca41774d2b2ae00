"""What to do about what daemons say of themselves, and where else to look."""

from __future__ import annotations

from typing import Literal

from schemas.mission.model import Mission
from schemas.wire.records import Health

KNOWN = {
    "failsafe: none": (
        "if the vehicle's own ground-station failsafe (FS_GCS_ENABLE) is to watch this bridge: "
        "`failsafe: {gcs: bridge}` at the robot in the mission, else `human` or `none` (docs/mavlink.md)"
    ),
    "failsafe: the vehicle does not tell": "is it an ArduPilot? `failsafe: {gcs: none}` for vehicles that have none",
    "failsafe: FS_GCS_ENABLE is 0": "set FS_GCS_ENABLE on the vehicle, or say `failsafe: {gcs: none}` in the mission",
    "no action is taken: operator": "when the agents may act again: `argosy stop release`",
    "no heartbeat from system": "see `vehicles`: is it switched on, is this its `sysid` and `link` in the mission?",
    "link ": "see `vehicles`: cable, device, baud rate or address of the robot's `link` in the mission",
}
"""What to do by how a note begins."""

BY_CODE = {
    "autopilot_unknown": "is this the right vehicle at the robot's `link` and `sysid`? Only ArduPilot is flown "
    "(docs/mavlink.md)",
    "foreign_packets": "who speaks there? Sign the vehicle's link (docs/mavlink.md, signing)",
    "two_vehicles": "give each its own MAV_SYSID; if there is only one, somebody forges it: sign its link",
    "session_id_forged": "whose keys are these, and who has a copy? `argosy keys revoke` (docs/security.md)",
    "link_renewed": "was its commd stopped, or without processor? Nothing is to be done (docs/fleets.md, restarts)",
    "mail_went_back": "was a backup restored? Mail that was taken since then is lost: its senders are to send it again "
    "(docs/mail.md)",
    "robot_unattended": "`argosy why AGENT` tells what its program did last; `argosy stop land|rtl` acts now",
}
"""What to do about a note with a code."""
GRAVE = frozenset({"autopilot_unknown", "robot_unattended", "session_id_forged"})
"""Codes of notes that are errors: nothing flies until they end, something flies by itself, or somebody means harm."""


def level_of(note: str, health: Health) -> Literal["warning", "error"]:
    """Return how bad a note of a daemon is."""
    return "error" if any(one.code in GRAVE for one in health.coded if one.text == note) else "warning"


def remedy_of(note: str, otherwise: str) -> str:
    """Return what to do about a daemon's note, or where to look if that is not known."""
    return next((do for begins, do in KNOWN.items() if note.startswith(begins)), otherwise)


def logs_of(daemon: str, mission: Mission, board: str) -> str:
    """Return in words how to see why a daemon is not well, however it was started."""
    unit, whole = f"{daemon}@{mission.name}", f"board@{mission.name}"
    units = f"on {board}: `systemctl status {unit}` and `journalctl -u {unit} -n 50` (of one process: `{whole}`)"
    return _either(mission, "see what it prints", units)


def target_of(mission: Mission, verb: str, board: str) -> str:
    """Return in words how to look at (`status`), or `start`, all daemons of a board."""
    units = f"on {board}: `systemctl {verb} argosy-{mission.name}.target`"
    return _either(mission, "see what it prints" if verb == "status" else "start it", units)


def _either(mission: Mission, by_run: str, units: str) -> str:
    """Boards with addresses are meant to run units; of others nobody knows."""
    if any(board.address for board in mission.boards.values()):
        return units
    return f"with `argosy run`: {by_run}; with units, {units}"
