"""Places in percepts and actions: victims, waypoints, targets; everything with a latitude beside a longitude.

Programs do not say which of their numbers are degrees. Two neighbouring numbers count as a place if that is within
`NEAR` of a robot.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

from argosy.fleet_model.actions import ActionSeen
from argosy.fleet_model.term_values import Position, position_of
from schemas.geo import distance
from schemas.humanize import shortened
from schemas.wire.records import Perception
from schemas.wire.term_text import write
from schemas.wire.terms import Structure, Term

MOST = 1_000
"""Places that are kept."""
NEAR = 30_000.0
"""Metres from a robot within which two numbers count as a place, and a belief as an area."""
NEAR_NORTH = 0.28
"""Degrees of latitude that are more than `NEAR`."""
OWN = frozenset({"global_pos", "home_pos"})
"""Percepts of the robot's own position."""


@dataclass
class Place:
    """A place in a percept or an action."""

    id: str
    kind: Literal["percept", "action"]
    name: str
    """Of the percept or action: `victim`, `goto`."""
    text: str
    """As a program would write it: `victim(3,-27.6035,-48.5182)`."""
    agent: str
    position: Position
    """Latitude and longitude in degrees."""
    heard: float
    """Unix seconds."""
    present: bool = True
    """Whether it is still perceived, or its action still runs."""
    state: str = ""
    """State of the action."""


class Places:
    """The places by the percept or action that has them."""

    def __init__(self, most: int = MOST) -> None:
        self.all: dict[str, Place] = {}
        self._most = most

    def percept(self, agent: str, percept: Perception, robots: Callable[[], Iterable[Position]], now: float) -> None:
        """Take a percept of an agent at `now`, in seconds; `robots` returns the known positions of the fleet."""
        if percept.name in OWN:
            return
        identity = percept.key or tuple(range(len(percept.parameters)))
        key = ",".join(str(percept.parameters[one]) for one in identity if one < len(percept.parameters))
        id = shortened(f"{agent}/{percept.name}({key})")
        if percept.update == "remove":
            for one in [self.all[id]] if id in self.all else self._of(agent, percept) if not percept.key else []:
                one.present = False
            return
        position = place_in(percept.parameters, robots)
        if position is None:
            return
        if percept.update == "replace" and not percept.key:
            for one in self._of(agent, percept):
                one.present = False
        text = shortened(write(Structure(percept.name, percept.parameters)))
        self._keep(Place(id, "percept", shortened(percept.name), text, agent, position, now))

    def action(self, action: ActionSeen, robots: Callable[[], Iterable[Position]], now: float) -> None:
        """Take the state of an action at `now`, in seconds."""
        known = self.all.get(action.id)
        if known is not None:
            known.present, known.state = action.ended is None, action.state
            return
        position = place_in(action.parameters, robots)
        if position is not None:
            target = Place(action.id, "action", action.name, action.text, action.agent, position, now)
            target.present, target.state = action.ended is None, action.state
            self._keep(target)

    def forget(self, before: float) -> None:
        """Forget places that were heard before `before`, in seconds."""
        self.all = {id: one for id, one in self.all.items() if one.heard >= before}

    def _of(self, agent: str, percept: Perception) -> list[Place]:
        return [
            one
            for one in self.all.values()
            if (one.kind, one.agent, one.name) == ("percept", agent, shortened(percept.name))
        ]

    def _keep(self, place: Place) -> None:
        self.all.pop(place.id, None)
        self.all[place.id] = place
        if len(self.all) > self._most:
            gone = next((id for id, one in self.all.items() if not one.present), next(iter(self.all)))
            del self.all[gone]


def place_in(parameters: tuple[Term, ...], robots: Callable[[], Iterable[Position]]) -> Position | None:
    """Return the first two neighbouring parameters that are a place near a robot; None if there are none."""
    for first, second in pairwise(parameters):
        position = position_of(first, second)
        if position is not None and any(
            abs(position[0] - robot[0]) < NEAR_NORTH and distance(position, robot) <= NEAR for robot in robots()
        ):
            return position
    return None
