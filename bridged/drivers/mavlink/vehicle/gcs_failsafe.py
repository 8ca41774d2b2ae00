"""Whose heartbeats the vehicle's ground-station failsafe watches, and whether it is on (design section 9)."""

from __future__ import annotations

import math
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.autopilots.autopilot import Autopilot
from bridged.drivers.mavlink.vehicle.commands import Identity
from bridged.drivers.mavlink.vehicle.flight_modes import ModeTable
from schemas.mission.model import Failsafe, Ids
from schemas.wire.records import Note

TRIES = 4
TRY_EVERY = 1.0
"""Mission and wall seconds; an unknown parameter is answered by silence."""
GROUND_STATION = (255, 190)
"""The ids that ArduPilot takes for its ground station (MAV_GCS_SYSID), and a companion's usual component."""
COMPANION = dialect.MAV_COMP_ID_ONBOARD_COMPUTER

BY_FAILSAFE = Ids()


def our_ids(failsafe: Failsafe, vehicle: int, ids: Ids = BY_FAILSAFE) -> Identity:
    """Return the ids of the bridge: the ground station's for `gcs: bridge`, the vehicle's companion otherwise.

    `ids` of the mission override both.
    """
    system, component = GROUND_STATION if failsafe.gcs == "bridge" else (vehicle, COMPANION)
    return Identity(ids.system or system, ids.component or component, vehicle)


def id_problem(failsafe: Failsafe, vehicle: int, ids: Ids) -> str:
    """Why the `ids` of a mission undo its `failsafe`, or cannot be ours; empty if they are good."""
    us, station = our_ids(failsafe, vehicle, ids), GROUND_STATION[0]
    if (us.system, us.component) == (us.vehicle, us.autopilot):
        return f"{us.system}/{us.component} are the ids of the vehicle's own autopilot: choose another component"
    if failsafe.gcs == "bridge" and us.system != station:
        return (
            f"`failsafe: {{gcs: bridge}}` has no effect with system {us.system}: the vehicle watches the heartbeats of "
            f"its ground station, system {station} (MAV_GCS_SYSID); leave `system` out"
        )
    if failsafe.gcs == "human" and us.system == station:
        return (
            f"`failsafe: {{gcs: human}}` has no effect with system {station}: the heartbeats of this bridge would hide "
            "that the human's ground station is lost; leave `system` out"
        )
    return ""


class FailsafeCheck:
    """Reads the failsafe parameter back at each connect, and reports what is wrong.

    `speed` is mission seconds per wall second; `now` is in mission seconds.
    """

    def __init__(
        self, failsafe: Failsafe, identity: Identity, send: Callable[[dialect.MAVLink_message], None], speed: float
    ) -> None:
        self.claims_ground_station = failsafe.gcs == "bridge"
        """Our heartbeats keep the vehicle's failsafe quiet, so they stop when no agent is there."""
        self.parameter = ""
        """Its switch, off at 0; empty while the autopilot is not known."""
        self.value: float | None = None
        """Of the parameter; None = not reported yet."""
        self._failsafe = failsafe
        self._identity = identity
        self._send = send
        self._every = TRY_EVERY * max(1.0, speed)
        self._tries = 0
        self._next_at = math.inf
        self._stations_only = self._for_texts = False

    def begin(self, now: float, autopilot: Autopilot, modes: ModeTable) -> None:
        """Read the parameter of a vehicle that is connected (again) now (seconds), unless nobody needs to know it."""
        self.parameter = autopilot.station_failsafe(modes)
        self._stations_only = autopilot.texts_for_stations_only
        self._for_texts = self._stations_only and not self.claims_ground_station
        if self._failsafe.watches or self._for_texts:
            self.value, self._tries, self._next_at = None, 0, now

    @property
    def heartbeat_type(self) -> int | None:
        """MAV_TYPE of our heartbeats: a ground station's where the vehicle sends its texts to those only.

        Such heartbeats would hide the loss of another ground station from a failsafe that is on, so none (None) is sent
        until the vehicle has reported that. An onboard controller whose heartbeats end would be missed.
        """
        if self._for_texts and self.value is None and self._tries < TRIES:
            return None
        if self._stations_only and (self.claims_ground_station or self.value == 0):
            return int(dialect.MAV_TYPE_GCS)
        return int(dialect.MAV_TYPE_ONBOARD_CONTROLLER)

    def tick(self, now: float) -> None:
        """Request the parameter, and again while there is no answer; the time is in seconds."""
        if now < self._next_at:
            return
        if self.value is not None or self._tries >= TRIES:
            self._next_at = math.inf
            return
        self._tries += 1
        self._next_at = now + self._every
        name = self.parameter.encode()
        self._send(dialect.MAVLink_param_request_read_message(*self._identity.addressee, name, -1))

    def receive(self, message: dialect.MAVLink_message) -> None:
        """Take in a PARAM_VALUE; its name shows whether it is ours."""
        if message.param_id == self.parameter:
            self.value = message.param_value

    def notes(self) -> list[Note]:
        """Return the warnings that hold now."""
        match self._failsafe.gcs, self.value:
            case "none", _:
                return [Note("failsafe_none", "failsafe: none: if this bridge dies, nothing brings the vehicle home")]
            case "bridge" | "human", None if self._tries >= TRIES and self._next_at == math.inf:
                return [Note("failsafe_unknown", f"failsafe: the vehicle does not report {self.parameter}")]
            case "bridge" | "human", value if value is not None and value == 0:
                text = f"failsafe: {self.parameter} is 0 on the vehicle: its ground-station failsafe is off"
                return [Note("failsafe_off", text)]
            case _, value if self._for_texts and value:
                text = (
                    f"{self.parameter} is on: the vehicle sends texts to ground stations only, and this bridge is none"
                )
                return [Note("texts_missing", text)]
        return []
