"""Part "earlier": the slowest things that were found, as they were before this was measured and as they are now.

Product and benchmarks of today, and the product of `REVISION` under the benchmarks of today, run the same probes
(`benchmarks.earlier.probes`) in turn, in changing order.
"""

from __future__ import annotations

import statistics
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import msgspec

from benchmarks.earlier.page import blocks
from benchmarks.earlier.trees import tree
from benchmarks.parts import Goal, tell
from benchmarks.processes import BenchmarkFailed, lines, started
from benchmarks.results import ROOT

__all__ = ["Figures", "blocks", "goals", "measure", "pictures"]

REVISION: Final = "534f320"
"""The last one before anything of `make bench` was measured."""
PAIRS: Final = {"fleet": 2, "loop": 2, "percepts": 2, "crowd": 1}
"""How often each probe runs in both trees."""


@dataclass
class Both:
    """What a probe found, the mean of its runs."""

    then: dict[str, float]
    now: dict[str, float]


@dataclass
class Figures:
    """What the part measures."""

    revision: str = REVISION
    pairs: dict[str, int] = field(default_factory=lambda: dict(PAIRS))
    probes: dict[str, Both] = field(default_factory=dict)


def measure(quick: bool) -> Figures:
    """Run each probe in both trees. Raises BenchmarkFailed."""
    figures = Figures(pairs=dict.fromkeys(PAIRS, 1) if quick else dict(PAIRS))
    with tree(REVISION) as earlier:
        for name, pairs in figures.pairs.items():
            found: dict[Path, list[dict[str, float]]] = {earlier: [], ROOT: []}
            for number in range(pairs):
                for where in (earlier, ROOT) if number % 2 == 0 else (ROOT, earlier):
                    found[where].append(_probed(where, name, quick))
            figures.probes[name] = Both(_mean(found[earlier]), _mean(found[ROOT]))
            tell(f"{name}: {_told(figures.probes[name].then)}; now {_told(figures.probes[name].now)}")
    return figures


def _probed(where: Path, name: str, quick: bool) -> dict[str, float]:
    """Run a probe with the product that is in that folder."""
    # as a module of that folder: it finds that folder's packages first, and so does what it starts
    module = (sys.executable, "-m", "benchmarks.earlier.probes", name, *(["--quick"] if quick else []))
    with started(["env", "-C", str(where), *module]) as process:
        said = list(lines(process))
    for line in said:
        if line.startswith("FOUND "):
            return msgspec.json.decode(line[6:], type=dict[str, float])
    raise BenchmarkFailed(f"probe {name} in {where.name}: " + "\n".join(said[-3:]))


def _mean(runs: list[dict[str, float]]) -> dict[str, float]:
    return {name: statistics.fmean(one[name] for one in runs) for name in runs[0]}


def _told(found: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:,.1f}" for name, value in found.items())


def pictures(figures: Figures) -> dict[str, str]:
    """Return none."""
    return {}


def goals(figures: Figures) -> list[Goal]:
    """Nothing is asked."""
    return []
