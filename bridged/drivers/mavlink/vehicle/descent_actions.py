"""Which actions can bring a vehicle down that flies: of two vehicles with one system id, all that may still be asked.

Which of them an answer reaches is chance, so the driver neither arms nor moves them; a way down goes to both.
"""

from __future__ import annotations

from bridged.drivers.mavlink.actions.context import Call
from bridged.drivers.mavlink.vehicle.flight_modes import ModeTable
from schemas.manifest.loader import ActionEntry

WAYS_DOWN = frozenset({"landed", "home", "at_home", "mode", "armed"})
"""Confirmations of actions that can bring a vehicle down, or end its flight."""


def may_lead_down(entry: ActionEntry) -> bool:
    """Whether an action can bring a vehicle down that flies: landing, returning, or a mode or disarming that may."""
    return entry.confirm in WAYS_DOWN


def leads_down(entry: ActionEntry, call: Call, modes: ModeTable) -> bool:
    """Whether it does so with its arguments filled in: it starts no motors and sets no mode but the safe ones."""
    match entry.confirm:
        case "mode":
            return call.parameters[1] in (modes.hold, modes.land, modes.rtl)
        case "armed":
            return call.parameters[0] == 0.0
    return may_lead_down(entry)
