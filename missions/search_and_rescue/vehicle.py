"""A copter with a buoy that only pretends, for the tests of the programs: it does what it is told in a plausible time.

agentd test --env missions/search_and_rescue/vehicle.py:Vehicle missions/search_and_rescue
"""

from __future__ import annotations

from agentd import ActionFailed, Deferred, Environment, Literal, literal

SECONDS = {
    "set_mode": 0.2,
    "arm_motors": 2.0,
    "takeoff": 6.0,
    "goto": 10.0,
    "return_to_launch": 30.0,
    "drop_buoy": 0.5,
    "load_buoy": 0.5,
}
"""How long each action takes."""
HOME = (-27.604033, -48.518363)
CLOSED, OPEN = 1100, 1900
"""Microseconds of the latch."""
PER_FLIGHT = 20
"""Percent of the battery that a flight to a place and back takes; at home it is full at once."""


class Vehicle(Environment):
    """Perceived as the copters of the mission are; ``did(Actions)`` tells what it has done, last first."""

    def init(self, arguments: list[str]) -> None:
        self.mode, self.armed, self.altitude, self.place = "STABILIZE", False, 0.0, HOME
        self.latch, self.battery, self.charger, self.homed = CLOSED, 100, True, True
        self.done: list[Literal] = []
        self.broken: dict[str, str] = {}
        self.add_percept("bridge(up)")
        self._show()

    def execute(self, agent: str, action: Literal) -> bool | Deferred:
        name = action.functor
        match name:
            case "break_down":  # for tests: this action fails once, and why
                self.broken[action.args[0].functor] = action.args[1]
            case "be_flying":  # for tests: it is in the air, with so much battery left
                self.mode, self.armed, self.altitude, self.battery = "GUIDED", True, 10.0, action.args[0]
            case "be_open":
                self.latch = OPEN
            case "be_uncharged":  # for tests: nobody charges it at home
                self.charger, self.battery = False, action.args[0]
            case "lose_bridge":  # for tests: nothing is heard of the vehicle any more
                self.broken = dict.fromkeys(SECONDS, "the bridge is lost")
                self.clear_percepts()
                return True
            case "be_landed":  # for tests: the bridge is back, and others have landed the vehicle in this mode
                self.broken = {}
                self.mode, self.armed, self.altitude = action.args[0], False, 0.0
                self.add_percept("bridge(up)")
            case "start_cold" | "find_home":  # for tests: it does not know yet where home is, or knows it now
                self.homed = name == "find_home"
            case "see":  # for tests: its camera sees a victim, or no more
                self.replace_percept(literal("victim", *action.args))
            case _ if name in SECONDS:
                later = Deferred()
                self.after(SECONDS[name], lambda: self._end(action, later))
                return later
            case _:
                return super().execute(agent, action)
        self._show()
        return True

    def _end(self, action: Literal, later: Deferred) -> None:
        name = action.functor
        if name in self.broken:
            later.fail(self.broken.pop(name))
            return
        try:
            self._do(name, action)
        except ActionFailed as failed:
            later.fail(str(failed))
            return
        self.done.insert(0, action)
        self._show()
        later.succeed()

    def _do(self, name: str, action: Literal) -> None:
        match name:
            case "set_mode":
                self.mode = action.args[0]
            case "arm_motors":
                self.armed = True
            case "takeoff" | "goto" if not self.armed:
                raise ActionFailed("the motors are not armed")
            case "takeoff":
                self.altitude = float(action.args[0])
            case "goto":
                self.place, self.altitude = (action.args[0], action.args[1]), float(action.args[2])
                self.battery -= PER_FLIGHT
            case "return_to_launch":
                self.armed, self.altitude, self.place = False, 0.0, HOME
                self.battery = 100 if self.charger else self.battery
            case "drop_buoy":
                self.latch = OPEN
            case "load_buoy":
                self.latch = CLOSED

    def _show(self) -> None:
        self.replace_percept(literal("state", self.mode, True, self.armed))
        self.replace_percept(literal("altitude", self.altitude))
        self.replace_percept(literal("global_pos", *self.place))
        if self.homed:
            self.replace_percept(literal("home_pos", *HOME))
        else:
            self.remove_percept(literal("home_pos", *HOME))
        self.replace_percept(literal("battery", 0, 12.6, self.battery))
        self.replace_percept(literal("latch", self.latch))
        self.replace_percept(literal("did", [literal(one.functor) for one in self.done]))
