"""Style of plots: colours that colour-blind readers distinguish and that differ in grey, sizes for paper columns."""

from __future__ import annotations

from typing import Any, Final

from schemas.wire.records import State

INCH: Final = 25.4
"""Millimetres."""
WIDTHS: Final = {"one": 88.0, "two": 181.0}
"""Millimetres of one column and of two columns of a paper."""
NARROW: Final = 120.0
"""Millimetres below which the letters are smaller."""

INK, FAINT, GRID = "#1f2328", "#6e7781", "#e3e6ea"

ROBOTS: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
"""Okabe and Ito's; one for each robot, then from the first again with another line."""
LINES: Final = ("-", (0, (5, 1.5)), (0, (1.5, 1)), (0, (5, 1, 1, 1)))

OUTCOMES: Final[dict[State, tuple[str, str, str]]] = {
    "succeeded": ("#9ecae1", "", "succeeded"),
    "failed": ("#b2182b", "x", "failed"),
    "refused": ("#67001f", "x", "refused"),
    "timed_out": ("#f4a582", "x", "timed out"),
    "cancelled": ("#878787", "|", "cancelled"),
}
"""Colour of an action's bar by its outcome, the mark at its end, and the name."""
OPEN: Final = ("#ffffff", "", "no outcome recorded")

MODES: Final = ("#dbe9f6", "#fde3c4", "#d9efdf", "#efdbe8", "#f5f0bb", "#dddddd", "#cfeef2", "#f6d5cf")

PERFORMATIVES: Final = {
    "tell": "#0072B2",
    "untell": "#56B4E9",
    "achieve": "#D55E00",
    "ask": "#CC79A7",
    "reply": "#009E73",
    "other": "#6e7781",
}
"""Colour of a message's arrow by what kind of performative it has."""

SEEN_MARKERS: Final = ("*", "p", "h")
"""Of the kinds of places that robots saw."""
LEFT_MARKERS: Final = ("v", "X", "P")
"""Of the kinds of places where robots left something."""


def settings(narrow: bool) -> dict[str, Any]:
    """Return the settings of matplotlib: the same on every machine, whatever the user's own are."""
    size = 6.5 if narrow else 7.5
    return {
        "font.family": ["DejaVu Sans"],  # comes with matplotlib: any other would differ from machine to machine
        "font.size": size,
        "axes.labelsize": size,
        "axes.titlesize": size + 0.5,
        "xtick.labelsize": size - 0.5,
        "ytick.labelsize": size - 0.5,
        "legend.fontsize": size - 0.5,
        "legend.frameon": False,
        "axes.linewidth": 0.5,
        "axes.edgecolor": FAINT,
        "axes.labelcolor": INK,
        "text.color": INK,
        "xtick.color": INK,
        "ytick.color": INK,
        "xtick.major.width": 0.5,
        "ytick.major.width": 0.5,
        "xtick.major.size": 2.5,
        "ytick.major.size": 2.5,
        "grid.color": GRID,
        "grid.linewidth": 0.5,
        "axes.grid": True,
        "axes.axisbelow": True,
        "hatch.linewidth": 0.5,
        "text.parse_math": False,  # texts of agents may hold a dollar
        "svg.fonttype": "path",  # looks the same everywhere; the texts are written as comments
        "svg.hashsalt": "argosy",
        "pdf.fonttype": 42,  # fonts that publishers take
        "path.simplify": True,
        "path.simplify_threshold": 0.2,
    }


def performative_kind(performative: str, answers: bool) -> str:
    """Return the name of a message's kind in the legend."""
    if answers:
        return "reply"
    if performative.startswith("ask"):
        return "ask"
    if performative.startswith("un"):
        return "untell"
    return {"tell": "tell", "achieve": "achieve"}.get(performative, "other")
