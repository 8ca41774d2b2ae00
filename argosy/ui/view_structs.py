"""Views for the page, as JSON: one struct for each part. Times are Unix seconds of this machine, places are degrees.

Views of minds are sent as received (schemas/wire/mind_records.py, docs/reference/records.md), events and messages
(parts `message/NUMBER`) as the model has them (argosy/fleet_model). The part `defect` is a text: why the others stay as
they were.
"""

from __future__ import annotations

from typing import Literal

import msgspec

from argosy.fleet_model.activity import Doing
from schemas.wire.mind_records import IntentionView, MindView
from schemas.wire.records import RunState

_encoder = msgspec.json.Encoder()


def encoded(thing: object) -> bytes:
    """Return JSON."""
    return _encoder.encode(thing)


class View(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A part of the page; fields with their default value are left out."""


class NoteView(View, frozen=True, kw_only=True):
    """A warning of a member, or of several."""

    code: str
    """The kind of warning (docs/guides/monitoring.md)."""
    text: str
    about: str = ""
    level: Literal["warning", "error"] = "warning"
    names: tuple[str, ...] = ()
    """The members that have it, if it is shown for several."""


class HeadView(View, frozen=True, kw_only=True):
    """The fleet as a whole (part `head`)."""

    fleet: str = ""
    """Empty: not known yet."""
    fleets: tuple[str, ...] = ()
    """The fleets to choose from, if there are several and none was named."""
    mission: str = ""
    file: str = ""
    version: str = ""
    endpoint: str = ""
    router: Literal["up", "away", "never", "ended"] = "never"
    """`away`: it was reached before; `ended`: it has left with its run."""
    router_since: float = 0.0
    problem: str = ""
    """Why the fleet is not observed, or what is wrong with its mission; empty: nothing."""
    identity: str = ""
    """The name in our certificate; empty without keys."""
    observer: str = ""
    """Why orders are not allowed; empty if they are."""
    inject: bool | None = None
    """Whether the mission lets minds take orders; None = the mission is not known."""
    mission_differs: str = ""
    """The file that `argosy ui` was started with, if the fleet runs another mission."""
    run: RunState | None = None
    """None: no run is published, as in a fleet of boards. Of a run that goes on without its mission time."""
    run_silent: float | None = None
    """Time since when `argosy run` is silent; None = it is heard."""
    as_of: float | None = None
    """Time of the state that is shown, if the run is over; None = now."""
    notes: tuple[NoteView, ...] = ()
    """Warnings of several members; they are not repeated with each."""
    alarms: tuple[NoteView, ...] = ()
    """Notes that are errors; they are shown with each member, too."""
    mission_zero: float | None = None
    """Time of mission second 0; None = not known."""
    speed: float = 1.0
    """Mission seconds per wall second."""
    timeout: float | None = None
    """Mission seconds."""
    done: dict[str, bool] = {}
    """The mission's `done` formulas, `agent: formula`, and whether they hold."""
    failed: dict[str, bool] = {}
    tiles: bool = False
    unreached: tuple[str, ...] = ()
    """Boards that are not reached, each with the reason."""


class RunningView(View, frozen=True, kw_only=True):
    """An action that runs."""

    id: str
    text: str
    state: str
    began: float
    silent: float | None = None
    """Time of its last status, if that is old; None = it is fresh."""
    feedback: dict[str, float] = {}
    target: tuple[float, float] | None = None


class AgentView(View, frozen=True, kw_only=True):
    """An agent in the list (part `agent/NAME`)."""

    name: str
    board: str = ""
    robot: str = ""
    standing: str
    """Presence of its daemon: up, coming, silent, twice, unclaimed or missing (docs/guides/monitoring.md); ended =
    it left with its run."""
    since: float | None = None
    notes: tuple[NoteView, ...] = ()
    state: Doing = ""
    """Its activity; empty = its mind was not heard."""
    action: str = ""
    """The action that it waits for."""
    stale: float | None = None
    """When its mind was last heard, if that is old; None = it is fresh, or was never heard."""
    silent: float | None = None
    """Since when its mind does not answer."""
    why_silent: str = ""
    program: str = ""
    cycle: int = 0
    intentions: tuple[IntentionView, ...] = ()
    """The first ones, each with the top of its stack."""
    intention_count: int = 0
    belief_count: int = 0
    event_count: int = 0
    question_count: int = 0
    mailbox: int = 0
    dropped: int = 0
    actions: tuple[RunningView, ...] = ()


class RobotView(View, frozen=True, kw_only=True):
    """A robot on the map and in the list (part `robot/NAME`)."""

    name: str
    board: str = ""
    agents: tuple[str, ...] = ()
    standing: str
    since: float | None = None
    notes: tuple[NoteView, ...] = ()
    stale: float | None = None
    """Time of its state, if that is old; None = it is fresh."""
    lost: bool = False
    """Its vehicle is not heard any more; the other values are the last known ones."""
    mode: str = ""
    armed: bool = False
    position: tuple[float, float] | None = None
    altitude: float | None = None
    """Metres above home."""
    heading: float | None = None
    """Degrees from north, clockwise."""
    speed: float | None = None
    """Metres a second over ground."""
    battery: float | None = None
    """Percent."""
    satellites: int | None = None
    home: tuple[float, float] | None = None
    radius: float | None = None
    """Metres around home that it may not leave."""
    operator: str = ""
    """The operator's order that is in force."""
    paused: bool = False
    """An operator has paused it."""
    reported: dict[str, str] = {}
    """Last percepts of a robot that is not a vehicle."""


class BoardView(View, frozen=True, kw_only=True):
    """A board (part `board/NAME`)."""

    name: str
    standing: str
    since: float | None = None
    notes: tuple[NoteView, ...] = ()
    waiting: int = 0
    """Number of waiting messages."""
    problem: str = ""


class MarkView(View, frozen=True, kw_only=True):
    """A place that agents mention (in part `marks`)."""

    id: str
    kind: Literal["victim", "waypoint", "target", "place"]
    label: str
    position: tuple[float, float]
    agents: tuple[str, ...] = ()
    state: str = ""
    """Of a victim: `missing`, `promised`, `rescued`; of an action: its state."""
    text: str = ""


class AreaView(View, frozen=True, kw_only=True):
    """A rectangle that agents believe in: south, west, north, east."""

    agent: str
    label: str
    bounds: tuple[float, float, float, float]


class MarksView(View, frozen=True, kw_only=True):
    """All places and areas (part `marks`)."""

    marks: tuple[MarkView, ...] = ()
    areas: tuple[AreaView, ...] = ()
    left_out: int = 0


class OrderedView(View, frozen=True, kw_only=True):
    """An order to robots and its outcome (part `order/N`)."""

    number: int
    order: str
    at: float
    clicked: float
    """When the page gave it, by the page: it finds its own order by this."""
    state: Literal["looking", "waiting", "confirmed", "NOT confirmed", "NOT ordered"]
    """Of the whole order; `looking`: the robots are not known yet; `confirmed`: by all of at least one robot."""
    of: str = ""
    """`all`, or nothing for a single robot."""
    outcomes: dict[str, tuple[str, str]] = {}
    """By robot: `waiting`, `confirmed` or `NOT confirmed`, and the reason."""
    problem: str = ""
    """Why no robot was ordered."""


class SeenMind(View, frozen=True, kw_only=True):
    """A whole mind (part `mind/NAME`, for pages that look at it)."""

    heard: float | None
    mind: MindView | None = None
    """Without its plans: they are part `plans/NAME`."""
