"""The figure of a plot: its panels one below the other, in millimetres of paper, and the file that it is written to."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from io import BytesIO
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any, Final, Literal, get_args

import matplotlib
from matplotlib.figure import Figure

from argosy.plot import panels as plot_panels
from argosy.plot.data import Scene
from argosy.plot.map import plan, shape
from argosy.plot.style import INCH, NARROW, settings
from commd.process.state_dir import write_output

Panel = Literal["track", "altitude", "modes", "actions", "messages"]
PANELS: Final[tuple[Panel, ...]] = get_args(Panel)
FORMATS: Final = (".svg", ".png", ".pdf")
RESOLUTION: Final = 300
"""Dots per inch of a PNG."""
NOTHING: Final[dict[Panel, str]] = {
    "track": "no positions: no percept global_pos(Latitude, Longitude)",
    "altitude": "no altitudes: no percept altitude(Metres)",
    "modes": "no modes: no percept state(Mode, Connected, Armed)",
    "actions": "no actions",
    "messages": "no messages: no agent published its activity",
}
"""Message for a panel without data."""
_DIGITS = re.compile(rb"<!--.*?-->|scale\([^)]*\)|(-?\d+\.\d\d)\d+", re.DOTALL)
"""Numbers with more than two decimals, besides scales and comments, which hold the texts."""
_INDENT = re.compile(rb"\n +")
_LETTER = 0.56
"""Width of a letter by its height, about."""


@dataclass
class _Placed:
    """A panel and its place: inches from the figure's top."""

    name: Panel
    top: float
    height: float


def has(scene: Scene, panel: Panel) -> bool:
    """Whether a panel has data."""
    tracks = scene.tracks.values()
    match panel:
        case "track":
            return any(track.points for track in tracks)
        case "altitude":
            return any(track.heights for track in tracks)
        case "modes":
            return any(track.modes for track in tracks)
        case "actions":
            return bool(scene.actions)
        case _:
            return bool(scene.messages)


def write_plot(scene: Scene, panels: list[Panel], width: float, out: Path) -> None:
    """Draw the panels, all of which have something to show, and write them; `width` in millimetres.

    The same scene gives the same bytes. Raises OSError.
    """
    with matplotlib.rc_context(), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a letter that the font does not have is drawn as a box
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(settings(width < NARROW))
        figure = _draw(scene, panels, width / INCH)
        kind = out.suffix[1:]
        dated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {}}[kind]
        metadata = {"Creator" if kind != "png" else "Software": "argosy plot", "Title": f"{scene.title}"}
        drawn = BytesIO()
        figure.savefig(drawn, format=kind, dpi=RESOLUTION, metadata={**metadata, **dated})
    data = drawn.getvalue()
    if kind == "svg":  # without indents, and with two decimals, to be smaller: hundredths of a point are enough
        data = _INDENT.sub(b"\n", _DIGITS.sub(lambda found: found[1] or found[0], data))
    write_output(out, data)


def _draw(scene: Scene, panels: list[Panel], wide: float) -> Any:
    size = float(matplotlib.rcParams["font.size"]) / 72
    left = _left(scene, panels, size)
    inner = wide - left - 1.2 * size
    ordered = [panel for panel in PANELS if panel in panels]
    figure = Figure(figsize=(wide, 1.0))
    axes: dict[Panel, Any] = {}
    shared = None
    for panel in ordered:
        axes[panel] = figure.add_axes((0, 0, 1, 1), sharex=None if panel == "track" else shared)
        shared = shared if panel == "track" else axes[panel]
    legends = {panel: _contents(axes[panel], panel, scene, inner, len(ordered)) for panel in ordered}
    timed = [panel for panel in ordered if panel != "track"]
    if shared is not None:
        shared.set_xlim(scene.begin, scene.end)
    placed, top = [], 0.3 * size
    for panel in ordered:
        columns, rows = _table(legends[panel], inner, size)
        top += rows * 1.5 * size + (0.5 * size if rows else 0.3 * size)
        height = _height(scene, panel, inner, size)
        placed.append(_Placed(panel, top, height))
        _legend(axes[panel], legends[panel], columns, size, height)
        last = panel == "track" or panel == timed[-1]
        top += height + (3.2 * size if last else 0.5 * size)
        if not last:
            axes[panel].tick_params(labelbottom=False)
    for one in placed:
        axes[one.name].set_position((left / wide, 1 - (one.top + one.height) / top, inner / wide, one.height / top))
    if timed:
        axes[timed[-1]].set_xlabel("s of mission", labelpad=1.5)
    figure.set_size_inches(wide, top)
    return figure


def _contents(axes: Any, panel: Panel, scene: Scene, inner: float, panels: int) -> list[Any]:
    match panel:
        case "track":
            return plan(axes, scene, shape(scene))
        case "altitude":
            plot_panels.altitude(axes, scene)
            return plot_panels.robot_handles(scene) if panels == 1 or not has(scene, "track") else []
        case "modes":
            return plot_panels.modes(axes, scene, inner)
        case "actions":
            return plot_panels.actions(axes, scene)
        case _:
            return plot_panels.messages(axes, scene)


def _height(scene: Scene, panel: Panel, inner: float, size: float) -> float:
    """Return the height of a panel in inches."""
    match panel:
        case "track":
            return inner * shape(scene)
        case "altitude":
            return max(0.8, 0.16 * inner)
        case "modes":
            return size * 1.7 * len(plot_panels.mode_rows(scene))
        case "actions":
            return size * 1.35 * max(1, len(plot_panels.action_rows(scene)))
        case _:
            return size * 3.2 * max(1, len(plot_panels.message_rows(scene)) - 1) + size


def _left(scene: Scene, panels: list[Panel], size: float) -> float:
    """Return the inches that the names of rows and the axes' figures need."""
    rows: list[str] = []
    rows += plot_panels.mode_rows(scene) if "modes" in panels else []
    rows += plot_panels.message_rows(scene) if "messages" in panels else []
    if "actions" in panels:
        rows += [name or agent for agent, name in plot_panels.action_rows(scene)]
    return max([4.4 * size, *(_LETTER * size * len(row) + size for row in rows)])


def _table(handles: list[Any], inner: float, size: float) -> tuple[int, int]:
    """Return columns and rows of a legend: as few rows as its panel is wide enough for."""
    entries = [_LETTER * size * len(handle.get_label()) + 3.4 * size for handle in handles]
    for columns in range(len(entries), 0, -1):
        rows, longer = divmod(len(entries), columns)  # matplotlib fills columns, the first ones with one more
        ends = list(accumulate(rows + (column < longer) for column in range(columns)))
        widths = [max(entries[begin:end]) for begin, end in pairwise([0, *ends])]
        if sum(widths) <= inner or columns == 1:
            return columns, rows + bool(longer)
    return 1, 0


def _legend(axes: Any, handles: list[Any], columns: int, size: float, height: float) -> None:
    if handles:
        above = {"loc": "lower left", "bbox_to_anchor": (0.0, 1 + 0.1 * size / height), "borderaxespad": 0.0}
        spacing = {"handlelength": 1.6, "handletextpad": 0.5, "columnspacing": 1.3, "borderpad": 0.1}
        axes.legend(handles=handles, ncols=columns, labelspacing=0.25, **above, **spacing)
