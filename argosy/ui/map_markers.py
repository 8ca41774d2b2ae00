"""Markers of the map besides vehicles: victims, waypoints, targets and areas, from percepts, actions and beliefs.

A victim is a percept or belief `victim(Id,Lat,Lon)` or `found(Id,Lat,Lon)`; `held(Id,Agent)` shows that it is
promised and `rescued(Id)` that it is rescued, as in the search and rescue mission. An area is
`area(South,West,North,East)`. Everything else with a latitude beside a longitude is a place.
"""

from __future__ import annotations

from functools import lru_cache

from argosy.fleet_model.model import FleetModel
from argosy.fleet_model.places import NEAR, Place
from argosy.fleet_model.term_values import plain, position_of
from argosy.ui.view_structs import AreaView, MarksView, MarkView
from schemas.geo import distance
from schemas.wire.term_text import BadTerm, read, write
from schemas.wire.terms import Structure, to_float

VICTIMS = frozenset({"victim", "found", "survivor"})
WAYPOINTS = frozenset({"waypoint", "waypoints", "wp"})
MOST = 300
"""Marks on a map; the oldest are left out and counted."""


@lru_cache(4_096)
def literal(text: str) -> Structure | None:
    """Read the text of a belief; None if it is not a positive literal with arguments."""
    try:
        term = read(text)
    except (BadTerm, RecursionError):
        return None
    return term if isinstance(term, Structure) and not term.negated and term.args else None


def marks(model: FleetModel) -> MarksView:
    """Return the markers of the map."""
    found: dict[str, MarkView] = {}
    believed = [
        (name, term) for name, one in model.agents.items() for belief in one.believed if (term := literal(belief.text))
    ]
    robots = [at for one in model.robots.values() if (at := one.seen.position or one.seen.home)]
    states = _states(believed)
    for agent, term in believed:
        if (
            term.functor in VICTIMS
            and len(term.args) >= 3
            and (at := position_of(*term.args[1:3]))
            and _near(at, robots)
        ):
            _victim(found, plain(term.args[0]), at, agent, states, write(term))
    for place in model.places.all.values():
        _place(found, place, states)
    areas: dict[tuple[float, float, float, float], AreaView] = {}
    for agent, term in believed:
        numbers = [to_float(one) for one in term.args]
        if term.functor == "area" and len(numbers) == 4 and None not in numbers:
            south, west, north, east = (one or 0.0 for one in numbers)
            if south < north and west < east and _near((south, west), robots):
                areas.setdefault(
                    (south, west, north, east), AreaView(agent=agent, label="area", bounds=(south, west, north, east))
                )
    kept = list(found.values())[-MOST:]
    return MarksView(marks=tuple(kept), areas=tuple(areas.values())[:20], left_out=len(found) - len(kept))


def _states(believed: list[tuple[str, Structure]]) -> dict[str, str]:
    """Return the state of each victim by id; a victim is rescued if any agent believes it."""
    states: dict[str, str] = {}
    for _, term in believed:
        if term.functor == "held" and len(term.args) == 2:
            states.setdefault(plain(term.args[0]), f"promised to {plain(term.args[1])}")
    for _, term in believed:
        if term.functor == "rescued" and len(term.args) == 1:
            states[plain(term.args[0])] = "rescued"
    return states


def _victim(
    found: dict[str, MarkView], id: str, at: tuple[float, float], agent: str, states: dict[str, str], text: str
) -> None:
    key = f"victim {id}"
    known = found[key].agents if key in found else ()
    agents = known if agent in known else (*known, agent)
    found[key] = MarkView(
        id=key, kind="victim", label=id, position=at, agents=agents, state=states.get(id, "missing"), text=text[:200]
    )


def _place(found: dict[str, MarkView], place: Place, states: dict[str, str]) -> None:
    if place.kind == "action":
        if place.present:
            found[place.id] = MarkView(
                id=place.id, kind="target", label=place.name, position=place.position, agents=(place.agent,),
                state=place.state, text=place.text,
            )  # fmt: skip
        return
    belief = literal(place.text)
    id = plain(belief.args[0]) if belief is not None else place.text
    if place.name in VICTIMS and belief is not None:  # a victim stays marked where it was seen
        _victim(found, id, place.position, place.agent, states, place.text)
    elif place.present:
        kind = "waypoint" if place.name in WAYPOINTS else "place"
        label = id if kind == "waypoint" else place.name
        found[place.id] = MarkView(
            id=place.id, kind=kind, label=label, position=place.position, agents=(place.agent,), text=place.text  # type: ignore[arg-type]
        )  # fmt: skip


def _near(at: tuple[float, float], robots: list[tuple[float, float]]) -> bool:
    return any(distance(at, robot) <= NEAR for robot in robots)
