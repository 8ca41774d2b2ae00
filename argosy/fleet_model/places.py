"""Places that percepts and actions speak of: victims, waypoints, targets. Whatever has a latitude beside a longitude.

Nothing says which numbers of a program are degrees, so it is taken from where the fleet is: two numbers beside each
other that are a place within `NEAR` of a robot.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

from argosy.fleet_model.robots import ActionSeen, finite, written
from schemas.geo import distance
from schemas.humanize import shortened
from schemas.wire.records import Perception
from schemas.wire.terms import Term

MOST = 1_000
"""Places that are kept."""
NEAR = 30_000.0
"""Metres from a robot within which two numbers count as a place."""
OWN = frozenset({"global_pos", "home_pos"})
"""Percepts that tell where a robot itself is."""

Position = tuple[float, float]


@dataclass
class Place:
    """A place that somebody spoke of."""

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
    """Whether it is still perceived, or the action still runs."""
    state: str = ""
    """Of an action: how it stands."""


class Places:
    """Keeps the places by what told of them."""

    def __init__(self, most: int = MOST) -> None:
        self.all: dict[str, Place] = {}
        self.forgotten = 0
        self._most = most

    def percept(self, agent: str, percept: Perception, robots: Callable[[], Collection[Position]], now: float) -> None:
        """Take what an agent perceived; `robots` returns the positions that are known."""
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
        text = shortened(written(percept.name, percept.parameters))
        self._keep(Place(id, "percept", shortened(percept.name), text, agent, position, now))

    def action(self, action: ActionSeen, robots: Callable[[], Collection[Position]], now: float) -> None:
        """Take how an action stands."""
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
        """Forget what was told before that time."""
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
            self.forgotten += 1


def place_in(parameters: tuple[Term, ...], robots: Callable[[], Collection[Position]]) -> Position | None:
    """Return the first two neighbours among the parameters that are a place near a robot."""
    for first, second in pairwise(map(finite, parameters)):
        if first is None or second is None or not (-90 <= first <= 90 and -180 <= second <= 180):
            continue
        if any(distance((first, second), robot) <= NEAR for robot in robots()):
            return first, second
    return None
