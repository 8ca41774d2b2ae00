"""The pages: the fleet at a glance, an agent drilled down, the help."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

from rich.text import Text
from textual import events
from textual.binding import Binding, BindingType
from textual.widget import Widget

from argosy.fleet_model.model import FleetModel
from argosy.fleet_model.timeline import Entry, clock
from argosy.run.screen import STYLES
from argosy.watch import mind_page
from argosy.watch.overview_page import overview
from argosy.watch.page import Page, Pane, title
from argosy.watch.row_text import Row, head
from argosy.watch.scroll_pane import Choice, ScrollPane

WIDE, HIGH = 120, 30
"""Columns and lines of a terminal from which on all panes of an agent are shown together."""
MOST_FLEET = 0.6
"""Share of the screen that the fleet may take; the timeline has the rest."""
HELP = """\
argosy watch shows a running fleet. It only reads; `argosy stop` gives orders.

  arrows, page up and down, home, end   move                  tab, shift-tab   next pane
  enter    open the agent; explain a decision                 escape           back
  /        show only rows with these words; -word hides       space            pause the view, not the fleet
  1 2 3 4  an agent's mind, beliefs, decisions, timeline      q, ctrl-c        leave
  left, right   the agent before and after                    ?                this page

Marks: {well} there and well, in red: not well   {away} not there   {runs} an action that runs
{under} waits for the goal above it   ! a warning of a daemon

Old values show their age: a vehicle is dim if it was not heard for 3 s, a mind is SILENT if it has not
answered for 5 s. The mind of the opened agent is queried twice a second, each other one every 2 s,
the mailboxes every 2 s. Ages of beliefs, intentions and actions are seconds of the mission's clock.
"""
MOST_ENTRIES = 2_000
"""Rows that are shown."""


class Overview(Page):
    """The fleet above, what happens below."""

    KEYS = "enter look in  tab pane  / filter  space pause  ? help  q quit"
    LONG_KEYS = f"arrows choose  {KEYS}"

    def panes(self) -> Iterable[Widget]:
        """Return the fleet and its timeline."""
        self._team = Choice(self.watch_app.glyphs, id="members")
        self._events = ScrollPane(self.watch_app.glyphs, id="events", follow=True)
        self._events.filter = self.watch_app.filter
        self._timeline_rows = TimelineRows()
        yield Pane("fleet", self._team, id="team")
        yield Pane("timeline", self._events, id="timeline")

    def on_mount(self) -> None:
        """Begin with the fleet."""
        super().on_mount()
        self._team.focus()

    def top(self, model: FleetModel) -> Text:
        """Return the title of the fleet."""
        return title(model, self.watch_app.link.place.router)

    def draw(self, model: FleetModel) -> None:
        """Show the fleet and its timeline."""
        rows = overview(model, self.size.width, self.watch_app.glyphs)
        self.query_one("#team").styles.height = max(3, min(len(rows) + 1, round(self.size.height * MOST_FLEET)))
        self._team.show_rows(rows)
        self._events.show_rows(self._timeline_rows.update(model))

    def on_choice_opened(self, event: Choice.Opened) -> None:
        """Open the page of the agent, or of the robot's agent."""
        kind, _, name = event.key.partition(" ")
        model = self.watch_app.shown
        if kind == "robot":
            name = next((one for one in model.robots[name].agents if one in model.agents), "")
        if kind in ("robot", "agent") and name in model.agents:
            self.app.push_screen(AgentPage(name))


class AgentPage(Page):
    """One agent: all its panes if there is room, else one of them."""

    BINDINGS: ClassVar[list[BindingType]] = [
        *(Binding(str(number), f"pane({number - 1})", show=False) for number in range(1, 5)),
        Binding("left", "neighbour(-1)", show=False),
        Binding("right", "neighbour(1)", show=False),
    ]
    DEFAULT_CSS = """
    AgentPage #body.wide { layout: grid; grid-size: 2 2; grid-columns: 3fr 2fr; grid-rows: 1fr 1fr; grid-gutter: 0 1; }
    """
    KEYS = "1 mind  2 beliefs  3 decisions  4 timeline  / filter  space pause  esc back"
    LONG_KEYS = f"{KEYS}  tab pane  left right other agents  ? help  q quit"
    ORDER = ("mind", "beliefs", "decisions", "happened")

    def __init__(self, agent: str) -> None:
        super().__init__()
        self.agent = agent
        self._opened: set[str] = set()
        """Decisions that are shown with their reasons."""
        self._shown = "mind"

    def panes(self) -> Iterable[Widget]:
        """Return mind, beliefs, decisions and timeline."""
        glyphs = self.watch_app.glyphs
        self._mind, self._beliefs = (
            ScrollPane(glyphs, id="rows-mind", wrap=True),
            ScrollPane(glyphs, id="rows-beliefs", wrap=True),
        )
        self._decisions = Choice(glyphs, id="rows-decisions", wrap=True)
        self._events = ScrollPane(glyphs, id="rows-happened", wrap=True, follow=True)
        self._timeline_rows = self._of_agent()
        yield Pane("1 mind", self._mind, id="mind")
        yield Pane("2 beliefs", self._beliefs, id="beliefs")
        yield Pane("3 decisions (enter: why)", self._decisions, id="decisions")
        yield Pane("4 timeline", self._events, id="happened")

    def _of_agent(self) -> TimelineRows:
        agent = self.watch_app.link.model.agents.get(self.agent)
        return TimelineRows(self.agent, *filter(None, (agent.robot if agent is not None else "",)))

    def on_mount(self) -> None:
        """Begin to ask for the details of the mind."""
        self.watch_app.link.look_at(self.agent)
        super().on_mount()
        self._arrange()
        self._mind.focus()

    def on_unmount(self) -> None:
        """Stop asking for the details."""
        self.watch_app.link.look_away(self.agent)

    def on_resize(self, _: events.Resize) -> None:
        """Show all panes, or one."""
        self._arrange()

    def on_descendant_focus(self, event: events.DescendantFocus) -> None:
        """Show the focused pane."""
        if isinstance(event.widget, ScrollPane) and isinstance(event.widget.parent, Pane):
            self._shown = str(event.widget.parent.id)
            self._arrange()
        self.redraw()

    def _arrange(self) -> None:
        wide = self.size.width >= WIDE and self.size.height >= HIGH
        self.query_one("#body").set_class(wide, "wide")
        for pane in self.query(Pane):
            pane.set_class(not wide and pane.id != self._shown, "behind")

    def top(self, model: FleetModel) -> Text:
        """Return name and state of the agent."""
        agent = model.agents.get(self.agent)
        return Text(f"{self.agent} is forgotten") if agent is None else mind_page.title(model, agent)

    def draw(self, model: FleetModel) -> None:
        """Show the mind."""
        agent = model.agents.get(self.agent)
        if agent is None:
            return
        if self._seen("mind"):
            self._mind.show_rows(mind_page.mind(model, agent, self.watch_app.glyphs))
        if self._seen("beliefs"):
            self._beliefs.show_rows(mind_page.beliefs(agent, model.now()))
        if self._seen("decisions"):
            self._decisions.show_rows(mind_page.decisions(agent, self._opened, model.now()))
        if self._seen("happened"):
            self._events.show_rows(self._timeline_rows.update(model))

    def _seen(self, pane: str) -> bool:
        return not self.query_one(f"#{pane}").has_class("behind")

    def on_choice_opened(self, event: Choice.Opened) -> None:
        """Show or hide the reasons of a decision."""
        self._opened ^= {event.key}
        self.redraw()

    def action_pane(self, number: int) -> None:
        """Go to a pane."""
        self._shown = self.ORDER[number]
        self._arrange()
        self.redraw()
        self.query_one(f"#{self._shown}", Pane).lines.focus()

    def action_neighbour(self, by: int) -> None:
        """Go to the agent before (`by` -1) or after (1)."""
        names = list(self.watch_app.shown.agents)
        if self.agent in names and len(names) > 1:
            link = self.watch_app.link
            link.look_away(self.agent)
            self.agent = names[(names.index(self.agent) + by) % len(names)]
            link.look_at(self.agent)
            self._opened.clear()
            self._timeline_rows = self._of_agent()
            self.redraw()


class Help(Page):
    """The keys."""

    KEYS = LONG_KEYS = "escape back"

    def panes(self) -> Iterable[Widget]:
        """Return the text."""
        self._text = ScrollPane(self.watch_app.glyphs, id="text", wrap=True)
        yield Pane("help", self._text, id="help")

    def on_mount(self) -> None:
        """Show it."""
        super().on_mount()
        self._text.focus()

    def top(self, model: FleetModel) -> Text:
        """Return the fleet's name."""
        return title(model, self.watch_app.link.place.router)

    def draw(self, model: FleetModel) -> None:
        """Show the text."""
        glyphs = self.watch_app.glyphs
        text = HELP.format(well=glyphs.well, away=glyphs.away, runs=glyphs.runs, under=glyphs.under)
        self._text.show_rows([Row(Text(line), indent=4) if line else head("") for line in text.splitlines()])


class TimelineRows:
    """The rows of a timeline; of one agent and its robot, if they are named."""

    def __init__(self, *names: str) -> None:
        self._names = frozenset(names)
        self._number = 0
        self._model: FleetModel | None = None
        self.rows: list[Row] = []
        self._entries: list[tuple[float, int, Row]] = []

    def update(self, model: FleetModel) -> list[Row]:
        """Return the rows for what the model has now."""
        if model is not self._model:  # paused, or going on again
            self._model, self._number, self._entries, self.rows = model, 0, [], []
        new = [
            (one.at, one.number, _entry_row(model, one))
            for one in model.timeline.since(self._number)
            if not self._names or one.who in self._names
        ]
        self._number = model.timeline.number
        if new:  # agents report a moment later than bridges: sort by time
            self._entries = sorted([*self._entries, *new], key=lambda entry: entry[:2])[-MOST_ENTRIES:]
            self.rows = [row for _, _, row in self._entries]
        return self.rows


def _entry_row(model: FleetModel, entry: Entry) -> Row:
    style = STYLES[entry.level] if entry.what not in ("sent", "received") else "magenta"
    seconds = model.clock.seconds(entry.at) if entry.mission is None else entry.mission
    time = clock(entry.at) if seconds is None else f"{seconds:8.1f}"
    text = Text.assemble((f"{time} ", "dim"), (f"{entry.who}  ", "bold"), (entry.text, style))
    return Row(text, indent=10, found_by=entry.what)
