"""Base of the pages: title, banner, panes with headings, filter line and keys."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, ClassVar, cast

from rich.text import Text
from textual import events
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Container, Vertical
from textual.screen import Screen
from textual.widget import Widget
from textual.widgets import Input, Static

from argosy.fleet_model.link import FleetLink
from argosy.fleet_model.model import FleetModel
from argosy.fleet_model.timeline import clock
from argosy.watch.row_text import BAD, GOOD, WARN, joined, safe, safe_text
from argosy.watch.scroll_pane import ScrollPane
from schemas.humanize import count, span

if TYPE_CHECKING:
    from argosy.watch.app import WatchApp
HINT_AFTER = 10.0
"""Seconds of waiting after which a possible reason is shown."""


class Pane(Vertical):
    """Rows below a heading that shows the position in them and the filter."""

    DEFAULT_CSS = """
    Pane { height: 1fr; }
    Pane > .heading { height: 1; }
    """

    def __init__(self, title: str, lines: ScrollPane, *, id: str) -> None:
        super().__init__(id=id)
        self.title, self.lines = title, lines
        self._heading = Static(classes="heading")
        self._text = Text()

    def compose(self) -> ComposeResult:
        """Put the heading above the rows."""
        yield self._heading
        yield self.lines

    def head(self, mark: str) -> None:
        """Update the heading; the mark shows the focused pane."""
        lines = self.lines
        total, seen = int(lines.virtual_size.height), lines.size.height
        first = lines.scroll_offset.y
        where = f"{first + 1}-{min(total, first + seen)} of {total}" if total > seen > 0 else ""
        left_out = f"filter: {lines.filter} ({lines.hidden} left out)" if lines.filter else ""
        style = "bold reverse" if lines.has_focus else "bold"
        heading = joined(
            (f"{mark if lines.has_focus else ' '}{self.title.upper()} ", style), (where, "dim"), (left_out, "yellow")
        )
        if heading != self._text:
            self._text = safe(heading)
            self._heading.update(heading)


class Page(Screen[None]):
    """A page of the view."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("slash", "filter", show=False),
        Binding("escape,backspace", "back", show=False),
        Binding("tab", "app.focus_next", show=False),
        Binding("shift+tab", "app.focus_previous", show=False),
    ]
    DEFAULT_CSS = """
    Page { layout: vertical; }
    Page > #title { height: 1; text-wrap: nowrap; text-overflow: clip; }
    Page > #banner { height: auto; max-height: 4; display: none; }
    Page > #body { height: 1fr; }
    Page > #keys { height: 1; text-style: dim; text-wrap: nowrap; text-overflow: clip; }
    Page > #filter { height: 1; border: none; padding: 0; display: none; }
    """
    KEYS = ""
    LONG_KEYS = ""

    def __init__(self) -> None:
        super().__init__()
        self._filtered: ScrollPane | None = None
        """The pane whose filter is being written."""
        self._banner, self._title = Text(), Text()

    @property
    def watch_app(self) -> WatchApp:
        """The application."""
        return cast("WatchApp", self.app)

    def compose(self) -> ComposeResult:
        """Stack everything."""
        yield Static(id="title")
        yield Static(id="banner")
        yield Container(*self.panes(), id="body")
        yield Input(id="filter", placeholder="words to show, -word to hide; enter keeps, escape clears")
        yield Static(id="keys")

    def panes(self) -> Iterable[Widget]:
        """Return the panes."""
        raise NotImplementedError

    def top(self, model: FleetModel) -> Text:
        """Return the title."""
        raise NotImplementedError

    def draw(self, model: FleetModel) -> None:
        """Show what a model has."""
        raise NotImplementedError

    def on_mount(self) -> None:
        """Begin to draw."""
        self.redraw()
        self.set_interval(self.watch_app.period, self.redraw)

    def on_screen_resume(self) -> None:
        """Draw what has changed while another page was shown."""
        self.redraw()

    def redraw(self) -> None:
        """Draw what is known now, or was when the view was paused."""
        if self.app.screen is not self or not self.is_mounted:
            return
        self._follow_size()
        model = self.watch_app.shown
        title, defect = self._title, self.watch_app.link.model.defect
        try:
            title = safe(self.top(model))
            self.draw(model)
        except Exception as error:  # one record must not take the view of a whole fleet away
            defect = f"this cannot be drawn, and stays as it was: {type(error).__name__}: {error}"
        lines = banner(self.watch_app.link, model, self.watch_app.paused)
        if defect:
            lines.insert(0, safe_text(f"defect in argosy watch: {defect}", BAD))
        above = Text("\n").join(map(safe, lines))
        if title != self._title:
            self._title = title
            self.query_one("#title", Static).update(title)
        if above != self._banner:
            self._banner = above
            widget = self.query_one("#banner", Static)
            widget.update(above)
            widget.display = bool(above.plain)
        for pane in self.query(Pane):
            pane.head(self.watch_app.glyphs.cursor)
        keys = self.LONG_KEYS if self.size.width >= 100 else self.KEYS
        self.query_one("#keys", Static).update(Text(keys))

    def _follow_size(self) -> None:
        """Lay the page out again if a new size of the terminal did not reach it.

        Textual passes it on by a one-shot timer of 8 ms, which never fires if it starts 8 ms late (`Timer._run`).
        """
        if self.outer_size != self.app.size:
            self.post_message(events.Resize(self.app.size, self.app.size))

    def focused_lines(self) -> ScrollPane | None:
        """Return the pane that has the keys."""
        return self.focused if isinstance(self.focused, ScrollPane) else None

    def action_filter(self) -> None:
        """Let a filter be written for the pane that has the keys."""
        self._filtered = self.focused_lines()
        if self._filtered is not None:
            line = self.query_one("#filter", Input)
            line.value, line.display = self._filtered.filter, True
            self.query_one("#keys").display = False
            self.set_focus(line)  # now: the letters that follow go there

    def on_input_changed(self, event: Input.Changed) -> None:
        """Filter while it is being written."""
        if self._filtered is not None:
            self._filtered.set_filter(event.value)

    def on_input_submitted(self, _: Input.Submitted) -> None:
        """Keep the filter."""
        self._end_filter()

    def action_back(self) -> None:
        """Leave the filter's line, or take the filter away, or go back to the page before."""
        lines = self.focused_lines()
        if self._filtered is not None:
            self._filtered.set_filter("")
            self._end_filter()
        elif lines is not None and lines.filter:
            lines.set_filter("")
        elif len(self.app.screen_stack) > 2:
            self.app.pop_screen()
        self.redraw()

    def _end_filter(self) -> None:
        lines, self._filtered = self._filtered, None
        self.query_one("#filter", Input).display = False
        self.query_one("#keys").display = True
        if lines is not None:
            self.set_focus(lines)
        self.redraw()


def title(model: FleetModel, router: str) -> Text:
    """Return the title: the fleet, and how many of its members are there."""
    there = [
        f"{sum(one.there for one in members.values())} of {count(len(members), what)}"
        for members, what in ((model.agents, "agent"), (model.robots, "robot"), (model.boards, "board"))
        if members
    ]
    others = f"also at this router: {', '.join(sorted(model.other_fleets))}" if model.other_fleets else ""
    return joined(
        (f"argosy watch {model.fleet or 'any fleet'}", "bold"),
        *there,
        (others, WARN),
        (_run_time(model), "dim"),
        (router, "dim"),
    )


def banner(link: FleetLink, model: FleetModel, paused: bool) -> list[Text]:
    """Return what is wrong with the view, a line for each problem."""
    now, lines = link.model.now(), list[Text]()
    live = link.model
    if live.over:
        lines += _ended(live)
    elif not link.reached:
        why = link.problem or f"dialling {link.place.router}"
        lines.append(safe_text(f"no router yet, waiting for {span(now - link.since)}: {why}", BAD))
        if now - link.since > HINT_AFTER:
            lines.append(
                safe_text("is the fleet running? For another router: --router ENDPOINT or --mission FILE", WARN)
            )
    elif not live.router_up:
        lost = now - (live.router_since or now)
        lines.append(
            safe_text(f"ROUTER LOST for {span(lost)}: the last known state is shown; reconnecting", "reverse bold red")
        )
    elif not any(one.there for members in (live.agents, live.robots, live.boards) for one in members.values()):
        who = f"no daemon of fleet {live.fleet}" if live.fleet else "no daemon"
        lines.append(safe_text(f"{who} is on the bus yet, waiting for {span(now - link.since)}", WARN))
        if now - link.since > HINT_AFTER:
            others = (
                f"at this router there is {', '.join(sorted(live.other_fleets))}: --fleet NAME; "
                if live.other_fleets
                else ""
            )
            lines.append(safe_text(f"{others}is it started (`argosy run` or its units)? See `argosy doctor`", WARN))
    if live.run_silent is not None:
        lines.append(
            safe_text(f"argosy run is not heard for {span(live.run_silent)}: nothing supervises this run now", WARN)
        )
    if paused:
        text = f"PAUSED as it was at {clock(model.now())}: the fleet goes on; space resumes the view"
        lines.append(safe_text(text, "reverse yellow"))
    return lines


def _run_time(model: FleetModel) -> str:
    """Return the mission time and the phase of the run; the time of day while no mission time is known."""
    seconds = model.clock.seconds(model.as_of)
    time = f"{clock(model.now())} (wall)" if seconds is None else f"{seconds:.0f} s of mission"
    return time if model.run_state is None else f"{model.run_state.phase.replace('_', ' ')}, {time}"


def _ended(model: FleetModel) -> list[Text]:
    """Return how the run has ended, and where its report and its recording are."""
    state = model.run_state
    assert state is not None
    after = f"after {state.mission_time:.1f} s"
    words = f"the mission is done {after}" if state.phase == "done" else f"the mission has failed {after}: {state.why}"
    kept = [f"{what}: {place}" for what, place in (("report", state.report), ("recording", state.recording)) if place]
    return [safe_text(words, GOOD if state.phase == "done" else BAD), *(safe_text(line) for line in kept)]
