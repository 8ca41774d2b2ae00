"""The pictures of the part "scale"."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from benchmarks import fits, plots
from benchmarks.scale.found import Run
from benchmarks.scale.growth import DAEMONS, easy

if TYPE_CHECKING:
    from benchmarks.scale.part import Figures


def pictures(figures: Figures) -> dict[str, str]:
    """Return the pictures of the page."""
    talkers, copters = figures.of("talkers"), figures.of("copters")
    found = {}
    with plots.figure(columns=2) as (made, (cpu, memory)):
        for kind in DAEMONS:
            _curve(cpu, talkers, _used(kind, "cpu"), kind, plots.COLOURS[kind])
            _curve(memory, talkers, _used(kind, "pss"), kind, plots.COLOURS[kind])
        if len(told := easy(talkers)) > 1:
            for kind in DAEMONS:
                line = fits.line([(one.size, one.use[kind].cpu) for one in told])
                sizes = [one.size for one in talkers]
                cpu.plot(sizes, [max(1e-2, line.at(size)) for size in sizes], ":", color=plots.COLOURS[kind])
        cpu.axhline(100.0, color="black", linewidth=0.8, linestyle="--")
        _axes(cpu, "processor time, % of a core")
        _axes(memory, "PSS, MB")
        made.suptitle("UAVs that only talk, one link (dotted: fitted; dashed: one core)", fontsize=9)
        found["scale-cost"] = plots.svg(made)
    with plots.figure(columns=2) as (made, (percept, action)):
        for axes, what in ((percept, "percept"), (action, "asked")):
            for row, style, name in ((talkers, "-", "talkers"), (copters, "--", "copters")):
                for part, colour in (("p50", "#2ca02c"), ("p99", "#ff7f0e"), ("max", "#d62728")):
                    _curve(
                        axes,
                        row,
                        _late(what, part),
                        f"{'worst' if part == 'max' else part}, {name}",
                        colour,
                        style,
                    )
        _axes(percept, "position to belief, ms")
        _axes(action, "action to its success, ms")
        found["scale-latency"] = plots.svg(made)
    return found


def _used(kind: str, what: str) -> Callable[[Run], float]:
    return lambda one: float(getattr(one.use[kind], what))


def _late(what: str, part: str) -> Callable[[Run], float]:
    return lambda one: float(getattr(getattr(one, what), part))


def _curve(axes: Any, row: list[Run], of: Callable[[Run], float], label: str, colour: str, style: str = "-") -> None:
    points = [(one.size, of(one)) for one in row if of(one) > 0 and math.isfinite(of(one))]
    if points:
        axes.plot(*zip(*points, strict=True), style, marker="o", markersize=3, color=colour, label=label)


def _axes(axes: Any, what: str) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("UAVs")
    axes.set_ylabel(what)
    axes.legend(fontsize=7, handlelength=3.5)
