"""The status of a fleet as a table, for a terminal of 80 columns and wider."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from argosy.fleet_model.fleet_status import Row, Standing
from schemas.humanize import latency, printable, span
from schemas.liveness import LAG_LATE
from schemas.wire.records import Note

STYLES: dict[Standing, str] = {
    "up": "green",
    "coming": "yellow",
    "silent": "bold red",
    "twice": "bold red",
    "unclaimed": "bold red",
    "missing": "bold red",
}
HEADS = ("board", "daemon", "name", "", "version", "for", "lag", "drops", "restarts")


def table(summary: str, rows: Sequence[Row], *, away: bool = False) -> RenderableType:
    """Return the table; `away`: the router does not answer, so the table shows the last known state."""
    grid = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim", collapse_padding=True)
    for head in HEADS:
        grid.add_column(head, no_wrap=True, justify="right" if head in HEADS[5:] else "left")
    board: str | None = None
    for row in rows:
        grid.add_row(*_cells(row, row.board if row.board != board else ""))
        board = row.board
    remarks = _words(rows)
    ill = any(not row.well for row in rows) or not rows
    last = Text(summary, style="bold red" if ill else "bold green")
    if away:
        last = Text("the router does not answer: this is the last known state", style="bold red")
    return Group(last, Text(), grid, *([Text(), *remarks] if remarks else []))


def _cells(row: Row, board: str) -> list[Text]:
    dim, title = "" if row.well else "dim", printable(row.title)
    mark = Text.assemble("● " if row.well else "✖ ", row.standing, style=STYLES[row.standing])
    if row.now is not None and row.now.paused:
        mark.append(" PAUSED", style="bold yellow")
    name = Text(title, style="bold") if row.in_mission else Text(f"{title} (not in the mission)", style="yellow")
    cells = [Text(printable(board), style="bold"), Text(printable(row.daemon)), name, mark]
    health = row.now
    if health is None:
        return cells
    late = health.lag >= LAG_LATE
    return [
        *cells,
        Text(printable(health.version) or "?", style=dim),
        Text(span(health.uptime), style=dim),
        Text(latency(health.lag), style="yellow" if late else dim),
        _count(health.drops, dim),
        Text("?", style="dim") if health.restarts is None else _count(health.restarts, dim),
    ]


def _words(rows: Sequence[Row]) -> list[Text]:
    """Return notes and last errors as lines; a note of several daemons once."""
    common: dict[tuple[str, Note, bool], list[str]] = {}
    for row in rows:
        for note in row.notes:
            common.setdefault((row.daemon, note, row.well), []).append(row.title)
    lines = [
        Text(printable(f"{daemon} {', '.join(names)}: {note.text}"), style="yellow" if well else "bold red")
        for (daemon, note, well), names in sorted(common.items(), key=lambda one: one[0][2])
    ]
    for row in rows:
        health = row.now
        if health is not None and health.last_error:
            age = (
                "before it was started again" if health.last_error_age is None else f"{span(health.last_error_age)} ago"
            )
            more = f", {health.errors} in all" if health.errors > 1 else ""
            text = f"{row.daemon} {row.title}: last error {age}{more}: {health.last_error}"
            lines.append(Text(printable(text), style="red"))
    return lines


def _count(number: int, style: str) -> Text:
    return Text(str(number), style="yellow" if number else style)
