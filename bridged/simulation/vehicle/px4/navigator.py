"""AUTO.MISSION of the simulated PX4: which item is flown, when it is done, and what is reported of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridged.simulation.vehicle.mission_items import RELATIVE_FRAMES, Item
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.motion.tasks import Task
from bridged.simulation.vehicle.notifications import ItemReached, MissionChanged, Number
from bridged.simulation.vehicle.px4 import missions
from bridged.simulation.vehicle.px4.missions import REPEATS, State
from bridged.simulation.vehicle.px4.modes import Mode
from bridged.simulation.vehicle.px4.texts import CRITICAL, TAKEOFF_NOT_FIRST

if TYPE_CHECKING:
    from bridged.simulation.vehicle.px4.px4 import Px4

_ALTITUDE_REACHED = 0.8
"""Metres beside the altitude of an item at which it is reached."""
_DO_CHANGE_SPEED = 178


class Navigator:
    """Flies the mission of one vehicle."""

    def __init__(self, px4: Px4) -> None:
        self._px4 = px4
        self._then: Task | None = None
        """What follows a takeoff that no item asks for."""

    @property
    def state(self) -> State:
        """mission_state of MISSION_CURRENT."""
        px4, mission = self._px4, self._px4.missions
        if not mission.valid:
            return State.NONE
        if mission.complete:
            return State.COMPLETE
        if px4.mode is Mode.RTL and px4.lands_by_mission:
            return State.PAUSED
        return State.ACTIVE if px4.mode is Mode.MISSION else State.NOT_STARTED

    def judge(self) -> None:
        """Check whether the mission can be flown; the reason why not is reported."""
        mission = self._px4.missions
        mission.problem = self._problem(mission.items) if mission.items else None
        if isinstance(mission.problem, str):
            self._px4.send_text(mission.problem, CRITICAL)
        elif mission.problem is not None:
            self._px4.events.append(Number(*mission.problem))
        self._px4.events.append(MissionChanged())

    def _problem(self, items: list[Item]) -> tuple[int, int] | str | None:
        px4 = self._px4
        flown = [item for item in items if item.command in missions.NAV_COMMANDS]
        if any(item.command == missions.TAKEOFF for item in flown[1:]):
            return TAKEOFF_NOT_FIRST
        for item in flown:
            if item.command in missions.WITH_PLACE and not px4.fence.allows(
                self._goal(item), px4.home_on_chart, px4.chart
            ):
                return f"Geofence violation for waypoint {item.seq + 1}"
        return px4.landing_problem(items)

    def start(self) -> None:
        """Fly the mission from its current item; on the ground from its first."""
        px4, mission = self._px4, self._px4.missions
        if not (px4.armed and mission.valid):
            return
        if mission.complete or not px4.flight.airborne:
            mission.current = 0
        mission.complete = False
        mission.jumped.clear()
        px4.send_text("Executing Mission")
        self._fly_from(mission.current)

    def replaced(self) -> None:
        """Go on with the new items where the mission is."""
        if self._px4.mode is Mode.MISSION and self._px4.armed and self._px4.missions.valid:
            self._fly_from(self._px4.missions.current)

    def jump_to(self, seq: int) -> bool:
        """MISSION_SET_CURRENT; returns False without such an item."""
        mission = self._px4.missions
        if mission.item(seq) is None:
            return False
        mission.current, mission.complete = seq, False
        if self._px4.mode is Mode.MISSION and self._px4.armed and mission.valid:
            self._fly_from(seq)
        self._px4.events.append(MissionChanged())
        return True

    def report(self) -> None:
        """Report the item that was reached last again, each second."""
        mission, now = self._px4.missions, self._px4.now
        if mission.reached is not None and now >= mission.next_repeat:
            mission.repeats -= 1
            mission.next_repeat = now + 1.0 if mission.repeats > 0 else math.inf
            self._px4.events.append(ItemReached(mission.reached))

    def _reached(self, seq: int) -> None:
        mission = self._px4.missions
        mission.reached, mission.repeats, mission.next_repeat = seq, REPEATS, self._px4.now + 1.0
        self._px4.events.append(ItemReached(seq))

    def follow(self) -> None:
        """Go on to the next item when the current one is done."""
        px4, mission = self._px4, self._px4.missions
        item = mission.item(mission.current)
        if item is None or mission.complete:
            return
        if self._then is not None:
            if px4.flight.reached:
                px4.flight.begin(self._then)
                self._then = None
            return
        if self._done(item):
            self._fly_from(item.seq + 1, after=item)

    def go_on(self) -> None:
        """Go on with the item after the current one."""
        mission = self._px4.missions
        item = mission.item(mission.current)
        self._fly_from(mission.current + 1, after=item)

    def landed(self) -> None:
        """Take note of a landing in the mission."""
        mission = self._px4.missions
        item = mission.item(mission.current)
        if item is None or item.command != missions.LAND or mission.complete:
            return
        mission.complete = True
        self._px4.send_text("Mission finished, landed")
        self._px4.events.append(MissionChanged())
        self._reached(item.seq)

    def _fly_from(self, seq: int, after: Item | None = None) -> None:
        px4, mission = self._px4, self._px4.missions
        between, item = mission.next_place(seq)
        for one in between:
            if one.command == _DO_CHANGE_SPEED and one.params[1] > 0:
                px4.flight.cruise_speed = one.params[1]
        if item is None or (item.command == missions.RTL and after is not None):
            last = mission.items[-1].seq if item is None else item.seq
            mission.current, mission.complete = last, True
            px4.send_text("Mission finished, loitering")
            px4.settle_in(Mode.LOITER, px4.going(self._end(after)) if after is not None else None)
            px4.events.append(MissionChanged())
            self._reached(last)
            if item is not None:
                self._return()
            return
        if after is not None:
            self._reached(item.seq - 1)
        mission.current, mission.entered_at = item.seq, px4.now
        px4.events.append(MissionChanged())
        self._begin(item)

    def _end(self, last: Item) -> Vector:
        return self._goal(last) if last.command in missions.WITH_PLACE else self._px4.motion.position

    def _return(self) -> None:
        self._px4.send_text("Returning to launch")
        self._px4.set_mode(Mode.RTL)

    def _begin(self, item: Item) -> None:
        px4 = self._px4
        goal = self._goal(item)
        if item.command == missions.RTL:
            self._return()
            return
        if item.command == missions.TAKEOFF:
            self._take_off(item, goal)
            return
        task = px4.mission_task(item, goal)
        if px4.flight.airborne:
            px4.flight.begin(task)
        else:
            self._then = task
            lowest = px4.motion.up.position + px4.parameters["MIS_TAKEOFF_ALT"]
            px4.begin_takeoff(max(lowest, min(goal.up, lowest)))

    def _take_off(self, item: Item, goal: Vector) -> None:
        px4 = self._px4
        if px4.skips_takeoff and px4.flight.airborne:
            self._fly_from(item.seq + 1)
            return
        height = goal.up - px4.home_on_chart.up
        if px4.climbs_first:
            px4.send_text(f"Climb to {height:.1f} meters above home")
        if px4.flight.airborne:
            here = px4.motion.position
            px4.flight.begin(px4.going(Vector(here.north, here.east, goal.up), px4.motion.heading))
        else:
            px4.begin_takeoff(goal.up)

    def _done(self, item: Item) -> bool:
        px4, mission = self._px4, self._px4.missions
        match item.command:
            case missions.TAKEOFF:
                return px4.flight.reached or abs(self._goal(item).up - px4.motion.up.position) < _ALTITUDE_REACHED
            case missions.LOITER_UNLIM | missions.LAND:
                return False
            case missions.DELAY:
                return px4.now - mission.entered_at >= item.params[0]
            case missions.LOITER_TO_ALT:
                return px4.loiter_to_altitude_done(self._goal(item))
        goal, here = self._goal(item), px4.motion.position
        near = px4.near(goal) and abs(goal.up - here.up) <= max(_ALTITUDE_REACHED, px4.altitude_acceptance)
        if item.command == missions.WAYPOINT and item.params[0] <= 0:
            return near
        if not near:
            mission.entered_at = px4.now
        return near and px4.now - mission.entered_at >= item.params[0]

    def _goal(self, item: Item) -> Vector:
        px4 = self._px4
        home = px4.home or px4.chart.origin
        altitude = home.alt + item.z if item.frame in RELATIVE_FRAMES else item.z
        goal = px4.chart.at(item.x / 1e7, item.y / 1e7, altitude)
        if item.command not in missions.WITH_PLACE or (item.x == 0 and item.y == 0):
            here = px4.motion.position
            goal.north, goal.east = here.north, here.east
        return goal
