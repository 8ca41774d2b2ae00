"""Part `footprint`: the memory of each daemon at rest, as a multiple of a bare Python process with a Zenoh session.

All are measured some seconds after they serve, while nothing flies: the difference to the bare process is the cost of
Argosy itself. `tests/test_footprint.py` holds the ratios against bounds.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from benchmarks.parts import Goal, at_most, progress, table
from benchmarks.processes import BenchmarkFailed, Watched, alone, memory, pss
from benchmarks.results import ROOT, Origin
from benchmarks.serving import NAMES, Site, copied, environment, serving

REPEATS: Final = 3
SETTLED: Final = 8.0
"""Seconds from the moment at which a process serves until it is looked at: its start is over by then."""
TOGETHER: Final = ("commd", "bridged", "agentd", "client", "bare")
"""Those of one board, and what they are compared with."""
ALONE: Final = ("board", "bare")
BOUNDS: Final = {"commd": 2.2, "bridged": 2.5, "agentd": 2.5, "client": 2.1, "board": 3.1}
"""So many times the resident memory of the bare process each may have, at most."""


@dataclass
class Held:
    """What one kind of process holds, one value for each time that it was started, in MB."""

    rss: list[float] = field(default_factory=list)
    """Resident, what it shares with others included."""
    pss: list[float] = field(default_factory=list)
    """The same with what is shared counted in parts."""
    threads: int = 0
    cpu: float = 0.0
    """Per cent of a core, at rest."""


@dataclass
class Figures:
    """What was measured."""

    held: dict[str, Held] = field(default_factory=dict)
    together: float | None = None
    """MB of a board's three daemons, each page counted once; None where the kernel does not report it."""
    in_one: float | None = None
    """The same of `argosy board`."""
    ratios: dict[str, list[float]] = field(default_factory=dict)
    """Resident memory in times of the bare process of the same run."""
    shares: dict[str, list[float]] = field(default_factory=dict)
    """The same of the proportional share."""

    def ratio(self, name: str) -> float:
        """Return how many bare processes a kind is as large as."""
        return statistics.median(self.ratios[name])


def measure(quick: bool) -> Figures:
    """Start everything, let it settle and look at it. Raises BenchmarkFailed."""
    figures = Figures()
    with tempfile.TemporaryDirectory() as folder:
        code = copied(Path(folder) / "code", compiled=True)
        for turn in range(1 if quick else REPEATS):
            for names in (TOGETHER, ALONE):
                look(figures, names, Path(folder) / f"{turn}-{names[0]}", code, 1.0 if quick else SETTLED)
            progress(", ".join(f"{name} {figures.ratios[name][-1]:.2f}" for name in BOUNDS))
    return figures


def probe(quick: bool) -> dict[str, float]:
    """Return the resident memory of each daemon at rest."""
    figures = Figures()
    with tempfile.TemporaryDirectory() as folder:
        for names in (TOGETHER, ALONE):
            look(figures, names, Path(folder) / names[0], ROOT, 1.0 if quick else SETTLED)
    return {f"{name} (MB)": statistics.median(one.rss) for name, one in figures.held.items() if name != "bare"}


def look(figures: Figures, names: tuple[str, ...], folder: Path, code: Path, settled: float) -> None:
    """Start some kinds of processes, the first of which brings the router, and note what they hold at rest."""
    site = Site.made(folder, code)
    with ExitStack() as stack:
        running = {name: stack.enter_context(serving(site, name, environment(code))) for name in names}
        time.sleep(settled / 2)
        used = {name: one.cpu() for name, one in running.items()}
        time.sleep(settled / 2)
        for name, one in running.items():
            _note(figures.held.setdefault(name, Held()), one, 100 * (one.cpu() - used[name]) / (settled / 2))
        bare = figures.held["bare"]
        for name in names:
            figures.ratios.setdefault(name, []).append(figures.held[name].rss[-1] / bare.rss[-1])
            figures.shares.setdefault(name, []).append(figures.held[name].pss[-1] / bare.pss[-1])
        ours = [one.process.pid for name, one in running.items() if name not in ("bare", "client")]
        if names == TOGETHER:
            figures.together = alone(ours)
        else:
            figures.in_one = alone(ours)


def _note(held: Held, process: Watched, cpu: float) -> None:
    pid = process.process.pid
    rss = memory(pid, "VmRSS")
    if not rss:
        raise BenchmarkFailed(f"{process.name} has ended: {process.output[-1:]}")
    held.rss.append(rss)
    held.pss.append(pss([pid]))
    held.threads, held.cpu = len(list(Path(f"/proc/{pid}/task").iterdir())), cpu


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the table."""
    lines = [
        origin.line(),
        "",
        f"At rest, {SETTLED:g} s after each serves; medians of {len(figures.ratios['agentd'])}. In brackets: in times "
        "of the bare process of the same run. MB = 10^6 bytes.",
        "",
        *table("| | RSS, MB | PSS, MB | threads | processor | bound in CI, RSS |"),
    ]
    for name in ("bare", *BOUNDS):
        held = figures.held[name]
        rss, share = f"{statistics.median(held.rss):.1f}", f"{statistics.median(held.pss):.1f}"
        bound = ""
        if name != "bare":
            rss += f" ({figures.ratio(name):.2f})"
            share += f" ({statistics.median(figures.shares[name]):.2f})"
            bound = f"{BOUNDS[name]:g}"
        lines.append(f"| {NAMES[name]} | {rss} | {share} | {held.threads} | {held.cpu:.1f} % | {bound} |")
    if figures.together is not None and figures.in_one is not None:
        lines += [
            "",
            f"Alone on a machine, each page counted once: the three daemons {figures.together:.1f} MB, `argosy board` "
            f"{figures.in_one:.1f} MB.",
        ]
    return {"footprint": "\n".join(lines)}


_WHY: Final = (
    "reason not known: a bound is a little more than what was found when it was set, so something grew since that is "
    "imported (tests/test_imports.py names it) or held; tried when the bounds were set: no modules that nobody needs "
    "(4bd9879)"
)


def goals(figures: Figures) -> list[Goal]:
    """Each daemon is to stay within the bound that CI holds it against."""
    return [
        at_most(f"RSS at rest of {NAMES[name]}", bound, figures.ratio(name), "bare processes", _WHY, digits=2)
        for name, bound in BOUNDS.items()
    ]
