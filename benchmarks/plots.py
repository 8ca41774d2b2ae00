"""Draw the pictures of the benchmarks: one size, one set of colours, SVG that is the same each time."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

WIDTH, HEIGHT = 7.0, 3.6
"""Inches of one picture."""
COLOURS: Final = {
    "agentd": "#1f77b4",
    "python": "#ff7f0e",
    "paper": "#999999",
    "bridged": "#2ca02c",
    "commd": "#9467bd",
}
"""Of who is shown, the same in all pictures."""


@contextmanager
def figure(columns: int = 1, rows: int = 1, width: float = WIDTH, height: float = HEIGHT) -> Iterator[tuple[Any, Any]]:
    """Make a figure and its axes, and close it behind the block."""
    import matplotlib as mpl

    mpl.use("svg")
    from matplotlib import pyplot

    with mpl.rc_context({"svg.hashsalt": "argosy", "svg.fonttype": "none", "font.size": 9, "axes.grid": True}):
        made, axes = pyplot.subplots(rows, columns, figsize=(width, height), constrained_layout=True)
        try:
            yield made, axes
        finally:
            pyplot.close(made)


def svg(made: Any) -> str:
    """Return a figure as SVG text."""
    file = io.StringIO()
    made.savefig(file, format="svg", metadata={"Date": None})
    return "\n".join(line.rstrip() for line in file.getvalue().splitlines()) + "\n"
