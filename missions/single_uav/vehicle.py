"""A vehicle that only pretends, for the tests of uav.asl: it does what it is told in a plausible time.

agentd test --env missions/single_uav/vehicle.py:Vehicle missions/single_uav
"""

from __future__ import annotations

from agentd import ActionFailed, Deferred, Environment, Literal, literal

SECONDS = {"set_mode": 0.2, "arm_motors": 2.0, "takeoff": 6.0, "goto": 30.0, "return_to_launch": 40.0, "land": 8.0}
"""How long each action takes."""
HOME_AFTER = 40.0
"""How long it takes to come home."""


class Vehicle(Environment):
    """Perceived as ``state(Mode, Connected, Armed)``; ``did(Actions)`` tells what it has done, last first."""

    def init(self, arguments: list[str]) -> None:
        self.mode, self.armed, self.altitude = "STABILIZE", False, 0.0
        self.done: list[str] = []
        self.broken: dict[str, str] = {}
        self.add_percept("bridge(up)")
        self._show()

    def execute(self, agent: str, action: Literal) -> bool | Deferred:
        name = action.functor
        if name == "break_down":  # for tests: from now on this action fails, and why
            self.broken[action.args[0].functor] = action.args[1]
            return True
        if name == "be_sent":  # for tests: others set this mode, and a flying vehicle comes down by it
            self.mode = action.args[0]
            self.replace_percept(literal("override", self.mode))
            self.after(HOME_AFTER, self._land)
            self._show()
            return True
        if name not in SECONDS:
            return super().execute(agent, action)
        later = Deferred()
        self.after(SECONDS[name], lambda: self._end(action, later))
        return later

    def _land(self) -> None:
        self.armed, self.altitude = False, 0.0
        self._show()

    def _end(self, action: Literal, later: Deferred) -> None:
        name = action.functor
        if later.cancelled:  # its intention was dropped: what it has begun is not done
            return
        if name in self.broken:
            later.fail(self.broken[name])
            return
        try:
            self._do(name, action)
        except ActionFailed as failed:
            later.fail(str(failed))
            return
        self.done.insert(0, name)
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
                self.altitude = float(action.args[2])
            case "return_to_launch" | "land":
                self._land()

    def _show(self) -> None:
        self.replace_percept(literal("state", self.mode, True, self.armed))
        self.replace_percept(literal("altitude", self.altitude))
        self.replace_percept(literal("did", [literal(name) for name in self.done]))
