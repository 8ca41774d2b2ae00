"""Failsafes of the simulated PX4: what is lost or low, what is done about it, and when it is over."""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING

from bridged.simulation.vehicle.autopilot import ChargeState
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.notifications import Text
from bridged.simulation.vehicle.px4.modes import Mode
from bridged.simulation.vehicle.px4.texts import CRITICAL

if TYPE_CHECKING:
    from bridged.simulation.vehicle.px4.px4 import Px4

_AHEAD_S = 1.0
"""Seconds of its present motion that a vehicle must stay within the fence."""


class Cause(Enum):
    """What a failsafe acts on, the most urgent first."""

    EMERGENCY_BATTERY = "emergency battery"
    CRITICAL_BATTERY = "critical battery"
    FENCE = "fence"
    STICKS = "sticks"
    SETPOINTS = "setpoints"
    STATION = "ground station"
    POSITION = "position"


_ACTIONS = {
    Cause.STATION: ("NAV_DLL_ACT", {1: Mode.LOITER, 2: Mode.RTL, 3: Mode.LAND}),
    Cause.STICKS: ("NAV_RCL_ACT", {1: Mode.LOITER, 2: Mode.RTL, 3: Mode.LAND}),
    Cause.FENCE: ("GF_ACTION", {2: Mode.LOITER, 3: Mode.RTL, 5: Mode.LAND}),
    Cause.CRITICAL_BATTERY: ("COM_LOW_BAT_ACT", {2: Mode.LAND, 3: Mode.RTL}),
    Cause.EMERGENCY_BATTERY: ("COM_LOW_BAT_ACT", {2: Mode.LAND, 3: Mode.LAND}),
}
"""Parameter of each cause, and what its values do; others do nothing."""
_NUMBERS = {Mode.LOITER: 5, Mode.RTL: 6, Mode.LAND: 7}
"""What it does, by the number in the arguments of its EVENT (recorded)."""
_WITHOUT_HOLD = frozenset((Cause.SETPOINTS, Cause.POSITION))
"""Causes for which no pilot is waited for in AUTO.LOITER."""


class Failsafes:
    """The failsafe of one vehicle that acts, if one does."""

    def __init__(self, px4: Px4) -> None:
        self._px4 = px4
        self.acting: Cause | None = None
        self._wanted: Mode | None = None
        """What it does after the wait; None: it does that."""
        self._since = 0.0
        self._overruled: set[Cause] = set()
        self._reported = ChargeState.OK
        self._outside = False

    def clear(self) -> None:
        """Forget all, as the vehicle is disarmed."""
        self.acting = self._wanted = None
        self._overruled.clear()

    def overruled(self) -> None:
        """Let somebody's change of mode end what acts, until its cause is over."""
        if self.acting is not None:
            self._overruled |= self._causes()
            self.acting = self._wanted = None

    def check(self, dt: float) -> None:
        """Look at all causes; the last look was `dt` vehicle seconds ago."""
        px4 = self._px4
        self._links()
        self._battery()
        if not (px4.armed and px4.flight.airborne):
            return
        causes = self._causes()
        if Cause.FENCE in causes and not self._outside:
            px4.events.append(Text(CRITICAL, "Geofence: approaching or outside geofence"))
        self._outside = Cause.FENCE in causes
        self._overruled &= causes
        if self.acting is Cause.SETPOINTS and Cause.SETPOINTS not in causes:
            self.acting = None
            px4.switch_to(px4.intended)
        worst = next((cause for cause in Cause if cause in causes - self._overruled), None)
        order = list(Cause)
        if worst is not None and (self.acting is None or order.index(worst) < order.index(self.acting)):
            self._begin(worst)
        if self._wanted is not None and px4.now - self._since >= px4.parameters["COM_FAIL_ACT_T"]:
            self._act(self._wanted)

    def _begin(self, cause: Cause) -> None:
        px4 = self._px4
        action = self._action(cause)
        if action is None or px4.mode is Mode.LAND:
            return
        waits = self._wanted is not None
        already = self.acting is not None
        self.acting = cause
        if cause in _WITHOUT_HOLD or action is Mode.LOITER or (already and not waits):
            self._act(action)
            return
        self._wanted = action
        if waits:
            return
        self._since = px4.now
        wait = px4.parameters["COM_FAIL_ACT_T"]
        px4.send_text(f"Failsafe activated: entering Hold for {wait:.0f} seconds", CRITICAL, self._arguments(action))
        px4.switch_to(Mode.LOITER)

    def _act(self, mode: Mode) -> None:
        self._wanted, px4 = None, self._px4
        px4.send_text("Failsafe activated", CRITICAL, self._arguments(mode))
        px4.switch_to(mode)
        if self.acting is Cause.FENCE and mode is Mode.LOITER:
            px4.flight.begin(px4.holding())  # also in the mode that goes to a target

    def _arguments(self, mode: Mode) -> bytes:
        """Return the arguments of the EVENT: the mode that is wanted, and what is done instead."""
        return int(self._px4.intended).to_bytes(4, "little") + bytes([_NUMBERS[mode]])

    def _action(self, cause: Cause) -> Mode | None:
        if cause is Cause.SETPOINTS:
            return Mode.RTL
        if cause is Cause.POSITION:
            return Mode.LAND
        name, actions = _ACTIONS[cause]
        return actions.get(int(self._px4.parameters[name]))

    def _causes(self) -> set[Cause]:
        px4, causes = self._px4, set()
        if px4.battery.state is ChargeState.EMERGENCY:
            causes |= {Cause.EMERGENCY_BATTERY, Cause.CRITICAL_BATTERY}
        elif px4.battery.state is ChargeState.CRITICAL:
            causes.add(Cause.CRITICAL_BATTERY)
        if self._leaves_fence():
            causes.add(Cause.FENCE)
        if px4.intended.piloted and not px4.sticks.alive(px4.now):
            causes.add(Cause.STICKS)
        if px4.intended is Mode.OFFBOARD and not px4.setpoints_come:
            causes.add(Cause.SETPOINTS)
        if px4.links.station_silent(px4.now, px4.parameters["COM_DL_LOSS_T"]):
            causes.add(Cause.STATION)
        if px4.estimate.failed:
            causes.add(Cause.POSITION)
        return causes

    def _leaves_fence(self) -> bool:
        px4 = self._px4
        here, speed = px4.motion.position, px4.motion.velocity
        ahead = Vector(here.north + _AHEAD_S * speed.north, here.east + _AHEAD_S * speed.east, here.up)
        return not px4.fence.allows(ahead, px4.home_on_chart, px4.chart)

    def _links(self) -> None:
        px4, links = self._px4, self._px4.links
        lost = links.station_silent(px4.now, px4.parameters["COM_DL_LOSS_T"])
        if lost != links.station_lost:
            links.station_lost = lost
            px4.send_text("Connection to ground station lost" if lost else "GCS connection regained")
        gone = links.companion_silent(px4.now)
        if gone and not links.companion_lost:
            px4.send_text("Connection to mission computer lost", CRITICAL)
        links.companion_lost = gone

    def _battery(self) -> None:
        state = self._px4.battery.state
        if state > self._reported and self._px4.armed:
            text = {ChargeState.LOW: "Low battery", ChargeState.CRITICAL: "Critical battery"}.get(state)
            if text is not None:
                self._px4.send_text(text, CRITICAL)
        self._reported = state
