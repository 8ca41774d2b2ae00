"""What to do about what daemons say of themselves, and where else to look."""

from __future__ import annotations

from schemas.mission import Mission

KNOWN = {
    "failsafe: none": (
        "if the vehicle's own ground-station failsafe (FS_GCS_ENABLE) is to watch this bridge: "
        "`failsafe: {gcs: bridge}` at the robot in the mission (docs/mavlink.md)"
    ),
    "failsafe: the vehicle does not tell": "is it an ArduPilot? `failsafe: {gcs: none}` for vehicles that have none",
    "failsafe: FS_GCS_ENABLE is 0": "set FS_GCS_ENABLE on the vehicle, or say `failsafe: {gcs: none}` in the mission",
    "no action is taken: operator": "when the agents may act again: `argosy stop release`",
    "no heartbeat from system": "see `vehicles`: is it switched on, is this its `sysid` and `link` in the mission?",
    "link ": "see `vehicles`: cable, device, baud rate or address of the robot's `link` in the mission",
}
"""What to do by how a note begins."""


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
