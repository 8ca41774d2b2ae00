"""The way to a place: its end is the place, and it fails as soon as the vehicle no longer flies there."""

from __future__ import annotations

import math

from bridged.drivers.api import Outcome
from bridged.drivers.mavlink.actions.confirmation import SLOW, TARGET_NEAR
from bridged.drivers.mavlink.actions.context import SUCCEEDED, Ended, ProcedureContext, ProcedureRun, Steps
from bridged.drivers.mavlink.vehicle.state import Place

UNPLACED_FOR = (30.0, 10.0)
"""Mission and wall seconds without a position after which it is no longer waited for."""
NO_NEARER_FOR = (60.0, 10.0)
"""Mission and wall seconds in which a vehicle under way comes nearer: by `NEARER` metres over ground or in height. A
plane may turn around first."""
NEARER = 0.5
OTHER_FOR = 2
"""HEARTBEATs after the first report of another target that prove it: a change of the mode, which PX4 shows up to 1 s
later, says more, and one report may be an old datagram."""


def arrive(flight: ProcedureContext, run: ProcedureRun, goal: Place, tolerance: float | None) -> Steps:
    """Wait until the vehicle is within the tolerance of a point (metres above home) and, if it can stop, slow.

    The target that the vehicle has reported last is ours: another one is somebody else's.
    """
    vehicle, near, asked = flight.vehicle, tolerance or 1.0, flight.now
    taken, targets, other_at = vehicle.target, vehicle.targets, math.inf
    nearest, lowest, nearer_at = math.inf, math.inf, asked
    while True:
        if not vehicle.armed:
            return Outcome("failed", flight.with_texts("the vehicle disarmed on the way", asked))
        check_placed(flight, asked)
        if vehicle.targets > targets:
            targets = vehicle.targets
            other_at = (
                min(other_at, vehicle.heartbeats)
                if _differ(taken, vehicle.target, level=not vehicle.modes.ground)
                else math.inf
            )
        if vehicle.heartbeats >= other_at + OTHER_FOR:
            reason = "the vehicle has taken another target, which nobody here asked for (another ground station?)"
            return Outcome("failed", flight.with_texts(reason, asked), "pilot")
        if vehicle.position is not None:
            distance, height = vehicle.position.distance(goal), goal.altitude - vehicle.position.altitude
            run.feedback = {"distance": round(distance, 2), "speed": round(vehicle.speed, 2)}
            level = vehicle.modes.ground or abs(height) <= near
            if not vehicle.modes.ground:
                run.feedback["altitude"] = round(vehicle.position.altitude, 2)
            higher = "" if vehicle.modes.ground else f" and {height:+.1f} m of height"
            run.waits_for = f"arrival; {distance:.1f} m{higher} to go"
            if distance <= near and level and (vehicle.speed <= SLOW or not vehicle.modes.can_stop):
                return SUCCEEDED
            if distance < nearest - NEARER or (abs(height) < lowest - NEARER and not vehicle.modes.ground):
                nearest, lowest, nearer_at = min(distance, nearest), min(abs(height), lowest), flight.now
            if flight.now - nearer_at > (patience := flight.wait(*NO_NEARER_FOR)):
                reason = f"the vehicle has come no nearer for {patience:.0f} s (flown by others, or held up?)"
                return Outcome("failed", flight.with_texts(f"{reason}; {distance:.1f} m{higher} to go", nearer_at))
        yield


def check_placed(flight: ProcedureContext, since: float) -> None:
    """Raise Ended if the vehicle has not reported its position for long; `since`: what waits for it began then."""
    patience = flight.wait(*UNPLACED_FOR)
    if flight.now - max(flight.vehicle.position_at, since) > patience:
        reason = f"the vehicle has not reported its position for {patience:.0f} s, and may go on; {flight.state_text()}"
        raise Ended("failed", reason, "link")


def _differ(one: Place | None, other: Place | None, *, level: bool) -> bool:
    """Whether two targets are not the same; `level`: by altitude, too."""
    if one is None or other is None:
        return one is not other
    return one.distance(other) > TARGET_NEAR or (level and abs(one.altitude - other.altitude) > TARGET_NEAR)
