"""The session behind the pages of `argosy ui`: the link to the fleet, the views made of its model, and requests."""

from __future__ import annotations

import sys
from itertools import chain
from typing import Literal

from msgspec.structs import replace

from argosy.cli.operator_bus import Where
from argosy.cli.remedies import level_of
from argosy.fleet_model.link import FleetLink
from argosy.fleet_model.members import notes_of
from argosy.fleet_model.observer import Wanted
from argosy.ui.map_markers import marks
from argosy.ui.page_requests import ControlRequests
from argosy.ui.view_builders import agent_view, board_view, formulas, note_view, robot_view
from argosy.ui.view_diff import OF_MINDS, OF_PLANS, Page, Shown
from argosy.ui.view_structs import HeadView, SeenMind
from commd.process.log_handler import one_line
from schemas.version import RELEASE
from schemas.wire.records import Header, Note

FRESH = 0.2
"""Seconds for which the views are not made again."""
MESSAGES = 150
"""Messages of the chart."""
MARKED = 1.0
"""Seconds between two updates of the map markers."""
WANTED = Wanted(beliefs_per_tick=1)
"""The map shows beliefs."""
TRACK = 500
"""Points of each track that a new page gets."""


class FleetSession:
    """Everything that the server shows and does. Views are made only while a page is open."""

    def __init__(self, place: Where, identity: str = "", tiles: bool = False) -> None:
        """`identity` is the name in our certificate, if we have one; `tiles`: there are tiles for the map."""
        self.place, self.mission, self.identity = place, place.mission, identity
        self.link = FleetLink(place, WANTED, choosing=True, notify=_report)
        self.model = self.link.model
        self.shown = Shown(self.model.timeline, self._tracks)
        self._run = self.model.lives.run
        self.pages: set[Page] = set()
        self.requests = ControlRequests(self.link, self._robots, self._rights)
        self._tiles = tiles
        self._looked: frozenset[str] = frozenset()
        self._made = self._marked = 0.0
        self._marks = marks(self.model)
        self._defect = ""

    # What is shown.

    def refresh(self) -> None:
        """Update the views, unless that was just done."""
        now = self.model.now()
        if now - self._made < FRESH:
            return
        self._made = now
        try:
            self._bring(now)
        except Exception as error:  # shown on the page; its other parts and its orders go on
            what = f"a defect of argosy ui: {type(error).__name__}: {one_line(str(error))}"
            if what != self._defect:
                _report(what)
            self._defect = what
            self.shown.add({"defect": what, "head": self._head()} | self._ordered())
        else:
            self._defect = ""

    def _bring(self, now: float) -> None:
        self._look()
        if self.model.lives.run != self._run:
            self._run = self.model.lives.run
            self._marked = 0.0
            self.shown.begin_run()
        if now - self._marked >= MARKED:
            self._marked, self._marks = now, marks(self.model)
        self.shown.show(self._parts())

    def left(self, page: Page) -> None:
        """Forget a page and the minds that only it looked at."""
        self.pages.discard(page)
        self._look()

    def _look(self) -> None:
        """Ask for the minds that pages look at."""
        looked = frozenset(agent for page in self.pages for agent in page.looks_at)
        for agent in looked - self._looked:
            self.link.look_at(agent)
        for agent in self._looked - looked:
            self.link.look_away(agent)
        self._looked = looked

    def _parts(self) -> dict[str, object]:
        model = self.model
        robots = {} if model.mission is None else model.mission.robots
        shared = {note for note, names in self._notes().items() if len(names) > 1 and level_of(note) != "error"}
        parts: dict[str, object] = {"head": self._head(), "marks": self._marks}
        for name, agent in model.agents.items():
            parts[f"agent/{name}"] = agent_view(model, agent, shared)
        for name, robot in model.robots.items():
            parts[f"robot/{name}"] = robot_view(model, robot, robots.get(name), shared)
        for name, board in model.boards.items():
            parts[f"board/{name}"] = board_view(board)
        for message in model.messages.newest(MESSAGES):
            parts[f"message/{message.number}"] = message
        parts |= self._ordered()
        for name in self._looked & model.agents.keys():
            detail = model.agents[name].detail
            shown = None if detail is None else replace(detail, header=Header(), plans=())
            parts[OF_MINDS + name] = SeenMind(heard=model.agents[name].detailed, mind=shown)
            parts[OF_PLANS + name] = () if detail is None else detail.plans
        return parts

    def _notes(self) -> dict[Note, list[str]]:
        model = self.model
        return notes_of(chain(model.agents.values(), model.robots.values(), model.boards.values()))

    def _ordered(self) -> dict[str, object]:
        return {f"order/{order.number}": order for order in self.requests.last}

    def _head(self) -> HeadView:
        link, model, mission, started_with = self.link, self.model, self.model.mission, self.mission
        router: Literal["up", "away", "never", "ended"] = "up" if link.up else "away" if link.reached else "never"
        if router == "away" and model.over:
            router = "ended"
        differs = started_with is not None and mission is not None and mission.text != started_with.text
        notes = [note_view(note, names) for note, names in self._notes().items()]
        run, silent = model.run_state, model.run_silent
        if run is not None:
            run = replace(run, header=Header(), mission_time=run.mission_time if model.over else 0.0)
        return HeadView(
            fleet=link.fleet,
            fleets=link.fleets if not link.fleet else (),
            mission="" if mission is None else mission.name,
            file="" if mission is None else mission.path.name,
            version=RELEASE,
            endpoint=self.place.router,
            router=router,
            router_since=link.since,
            problem=link.problem or model.mission_problem if link.reached else link.problem or "looking for the router",
            identity=self.identity,
            observer=self._rights(),
            inject=None if mission is None else mission.inject,
            mission_differs=started_with.path.name if started_with is not None and differs else "",
            run=run,
            run_silent=None if silent is None else round(model.now() - silent, 1),
            as_of=model.as_of if model.over else None,
            notes=tuple(one for one in notes if one.level == "warning" and len(one.names) > 1),
            alarms=tuple(one for one in notes if one.level == "error"),
            mission_zero=model.clock.zero,
            speed=model.clock.speed,
            timeout=None if mission is None else mission.timeout,
            done=formulas(model, mission.done if mission else (), "done"),
            failed=formulas(model, mission.failed if mission else (), "failed"),
            tiles=self._tiles,
            unreached=() if model.over else link.unreached,
        )

    def _tracks(self) -> dict[str, list[tuple[float, float]]]:
        """Return the track of each robot, thinned to about `TRACK` points."""
        tracks: dict[str, list[tuple[float, float]]] = {}
        for name, robot in self.model.robots.items():
            points = robot.seen.track.points
            step = max(1, len(points) // TRACK)
            tracks[name] = [(one.latitude, one.longitude) for one in points[::step]]
        return tracks

    # What is asked.

    def _robots(self) -> list[str]:
        """Return whom an order to all is for; a board that publishes another mission takes no robot from it."""
        named = chain.from_iterable(one.robots for one in (self.mission, self.model.mission) if one is not None)
        return list(dict.fromkeys([*named, *(name for name, one in self.model.robots.items() if one.there)]))

    def _rights(self) -> str:
        """Return why orders are not allowed; empty if they are."""
        if self.mission is not None and self.identity in self.mission.security.observers:
            return f"`{self.identity}` is an observer in the mission: it may not give orders"
        return ""


def _report(text: str) -> None:
    print(f"argosy ui: {text}", file=sys.stderr, flush=True)
