"""What the pages of the view share: title, banner, panes with headings, the line for a filter, the keys."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, ClassVar, cast

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Container, Vertical
from textual.screen import Screen
from textual.widget import Widget
from textual.widgets import Input, Static

from argosy.fleet_model import TeamModel
from argosy.watch.banner import banner
from argosy.watch.row_text import BAD, joined, safe, said
from argosy.watch.scroll_pane import ScrollPane

if TYPE_CHECKING:
    from argosy.watch.app import WatchApp


class Pane(Vertical):
    """Rows below a heading that tells of how many there are more than seen, and what is left out."""

    DEFAULT_CSS = """
    Pane { height: 1fr; }
    Pane > .heading { height: 1; }
    """

    def __init__(self, title: str, lines: ScrollPane, *, id: str) -> None:
        super().__init__(id=id)
        self.title, self.lines = title, lines
        self._heading = Static(classes="heading")
        self._told = Text()

    def compose(self) -> ComposeResult:
        """Put the heading above the rows."""
        yield self._heading
        yield self.lines

    def head(self, mark: str) -> None:
        """Tell what is shown; the mark stands before the pane that has the keys."""
        lines = self.lines
        total, seen = int(lines.virtual_size.height), lines.size.height
        first = lines.scroll_offset.y
        where = f"{first + 1}-{min(total, first + seen)} of {total}" if total > seen > 0 else ""
        left_out = f"filter: {lines.filter} ({lines.hidden} left out)" if lines.filter else ""
        style = "bold reverse" if lines.has_focus else "bold"
        told = joined(
            (f"{mark if lines.has_focus else ' '}{self.title.upper()} ", style), (where, "dim"), (left_out, "yellow")
        )
        if told != self._told:
            self._told = safe(told)
            self._heading.update(told)


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

    def top(self, model: TeamModel) -> Text:
        """Return the title."""
        raise NotImplementedError

    def draw(self, model: TeamModel) -> None:
        """Show what a model has."""
        raise NotImplementedError

    def on_mount(self) -> None:
        """Begin to draw."""
        self.redraw()
        self.set_interval(self.watch_app.period, self.redraw)

    def on_screen_resume(self) -> None:
        """Draw at once what has changed while another page was above."""
        self.redraw()

    def redraw(self) -> None:
        """Draw what is known now, or was when the view was paused."""
        if self.app.screen is not self or not self.is_mounted:
            return
        model = self.watch_app.shown
        title, defect = self._title, self.watch_app.link.model.defect
        try:
            title = safe(self.top(model))
            self.draw(model)
        except Exception as error:  # one record must not take the view of a whole fleet away
            defect = f"this cannot be drawn, and stays as it was: {type(error).__name__}: {error}"
        lines = banner(self.watch_app.link, model, self.watch_app.paused)
        if defect:
            lines.insert(0, said(f"defect in argosy watch: {defect}", BAD))
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
            line.focus()

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
            lines.focus()
        self.redraw()
