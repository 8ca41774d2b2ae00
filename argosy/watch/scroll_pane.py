"""Scrollable panes of rows. Only visible rows are drawn, so that thousands of rows cost as much as twenty."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from rich.segment import Segment
from rich.style import Style
from rich.text import Text
from textual.binding import Binding, BindingType
from textual.events import Resize
from textual.geometry import Size
from textual.message import Message
from textual.scroll_view import ScrollView
from textual.strip import Strip

from argosy.watch.row_text import Glyphs, Row


class ScrollPane(ScrollView, can_focus=True):
    """Rows that are scrolled through."""

    DEFAULT_CSS = """
    ScrollPane { height: 1fr; overflow-x: hidden; overflow-y: auto; scrollbar-size: 0 0; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up,k", "step(-1)", show=False),
        Binding("down,j", "step(1)", show=False),
        Binding("pageup", "page(-1)", show=False),
        Binding("pagedown", "page(1)", show=False),
        Binding("home,g", "ends(-1)", show=False),
        Binding("end,G", "ends(1)", show=False),
    ]

    def __init__(self, glyphs: Glyphs, *, id: str, wrap: bool = False, follow: bool = False) -> None:
        """`wrap`: long rows are wrapped; `follow`: a pane that is scrolled to its end stays there."""
        super().__init__(id=id)
        self.filter = ""
        """Words that a row must have to be shown."""
        self.hidden = 0
        """Rows that the filter leaves out."""
        self._wrap, self._instead, self._mark = wrap, glyphs.instead, glyphs.cursor
        self._follows, self._at_end = follow, follow
        self._all: list[Row] = []
        self._rows: list[Row] = []
        self._lines: list[tuple[int, Text]] = []
        """The lines on the screen, each with the number of its row."""

    @property
    def rows(self) -> list[Row]:
        """The rows that are shown."""
        return self._rows

    def show_rows(self, rows: Sequence[Row]) -> None:
        """Show these rows; nothing is drawn if they are as before."""
        if list(rows) != self._all:
            self._all = list(rows)
            self._lay_out()

    def set_filter(self, text: str) -> None:
        """Show only what matches."""
        self.filter = text.strip()
        self._lay_out()

    def action_step(self, by: int) -> None:
        """Scroll by some lines."""
        self._go_to(self.scroll_offset.y + by)

    def action_page(self, by: int) -> None:
        """Scroll by some pages."""
        self._go_to(self.scroll_offset.y + by * max(1, self.size.height - 1))

    def action_ends(self, which: int) -> None:
        """Scroll to the first line for a negative number, else to the last."""
        self._go_to(0 if which < 0 else len(self._lines))

    def _to_end(self) -> None:
        if self._at_end:
            self._go_to(len(self._lines))

    def _go_to(self, line: int) -> None:
        last = max(0, len(self._lines) - self.size.height)
        self._at_end = self._follows and line >= last
        self.scroll_to(y=max(0, min(line, last)), animate=False, immediate=True)

    def on_resize(self, _: Resize) -> None:
        """Lay the rows out for the new size."""
        self._lay_out()

    def render_line(self, y: int) -> Strip:
        """Draw one line of the screen."""
        line, style, width = y + self.scroll_offset.y, self.rich_style, self.size.width
        if line >= len(self._lines):
            return Strip.blank(width, style)
        number, text = self._lines[line]
        return Strip(self._drawn(number, text)).adjust_cell_length(width).apply_style(style)

    def _drawn(self, number: int, text: Text) -> list[Segment]:
        """Return a line of a row as it is drawn."""
        return [Segment(" "), *self._segments(text)]

    def _segments(self, text: Text) -> list[Segment]:
        console = self.app.console
        if not text.spans:  # rich leaves out the style of a text that has one style only
            segments = [Segment(text.plain, console.get_style(text.style))]
        else:
            segments = list(text.render(console))
        if not self._instead:
            return segments
        return [Segment(one.text.translate(self._instead), one.style) for one in segments]

    def _lay_out(self) -> None:
        words = self.filter.lower().split()
        self._rows = [row for row in self._all if row.head or row.matches(words)]
        self.hidden = len(self._all) - len(self._rows)
        width = self.size.width - 1
        # Before it has its place it has no width: a line for each letter would be shown, and made for nothing.
        rows = enumerate(self._rows) if width > 0 else ()
        self._lines = [(number, line) for number, row in rows for line in self._folded(row, width)]
        self.virtual_size = Size(self.size.width, len(self._lines))
        if self._at_end:
            self.call_after_refresh(self._to_end)  # the size that it may scroll in is known then
        self.refresh()

    def _folded(self, row: Row, width: int) -> list[Text]:
        if row.text.cell_len <= width:
            return [row.text]
        if not self._wrap:
            text = row.text.copy()
            text.truncate(width, overflow="ellipsis")
            return [text]
        first, *rest = row.text.wrap(self.app.console, width, overflow="fold")
        if not rest or row.indent >= width // 2:
            return [first, *rest]
        left = row.text[len(first.plain) :]
        left = left[len(left.plain) - len(left.plain.lstrip()) :]
        more = left.wrap(self.app.console, width - row.indent, overflow="fold")
        return [first, *(Text(" " * row.indent).append_text(one) for one in more)]


class Choice(ScrollPane):
    """Rows of which one is chosen; those without a key cannot be."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("enter", "open", show=False)]

    class Opened(Message):
        """Enter was pressed on a row."""

        def __init__(self, pane: Choice, key: str) -> None:
            super().__init__()
            self.pane, self.key = pane, key

    def __init__(self, glyphs: Glyphs, *, id: str, wrap: bool = False) -> None:
        super().__init__(glyphs, id=id, wrap=wrap)
        self.chosen = ""
        """The key of the chosen row."""
        self._by_hand = False
        """Whether the user chose it; else the first row is chosen."""

    def action_step(self, by: int) -> None:
        """Choose the row some rows further."""
        keys = self._keys()
        if not keys:
            super().action_step(by)
            return
        at = keys.index(self.chosen) + by if self.chosen in keys else 0
        self._choose(keys[max(0, min(at, len(keys) - 1))])
        if at < 0:
            self._go_to(0)  # the headings above the first row

    def action_page(self, by: int) -> None:
        """Choose the row some pages further."""
        self.action_step(by * max(1, self.size.height - 2))

    def action_ends(self, which: int) -> None:
        """Choose the first row for a negative number, else the last."""
        keys = self._keys()
        if keys:
            self._choose(keys[0 if which < 0 else -1])
        super().action_ends(which)

    def action_open(self) -> None:
        """Open the chosen row, if there is one."""
        if self.chosen in self._keys():
            self._by_hand = True
            self.post_message(self.Opened(self, self.chosen))

    def _keys(self) -> list[str]:
        return [row.key for row in self._rows if row.key]

    def _choose(self, key: str) -> None:
        self.chosen, self._by_hand = key, True
        lines = [line for line, (number, _) in enumerate(self._lines) if self._rows[number].key == key]
        if lines:
            top, bottom = self.scroll_offset.y, self.scroll_offset.y + self.size.height - 1
            if lines[0] < top or len(lines) > self.size.height:
                self._go_to(lines[0])
            elif lines[-1] > bottom:
                self._go_to(lines[-1] - self.size.height + 1)
        self.refresh()

    def _lay_out(self) -> None:
        super()._lay_out()
        keys = self._keys()
        if not self._by_hand or self.chosen not in keys:
            self.chosen, self._by_hand = keys[0] if keys else "", False

    def _drawn(self, number: int, text: Text) -> list[Segment]:
        if not self.chosen or self._rows[number].key != self.chosen:
            return super()._drawn(number, text)
        segments = [Segment(self._mark), *self._segments(text)]
        if not self.has_focus:
            return segments
        over = Style(reverse=True)  # without colours: they would look like patches
        return [Segment(one.text, over) for one in [*segments, Segment(" " * self.size.width)]]
