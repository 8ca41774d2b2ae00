"""The report of a measurement as Markdown: docs/reasoner.md."""

from __future__ import annotations

import platform
import statistics
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from benchmarks.footprint import FOOTPRINTS
from benchmarks.processes import Speeds
from benchmarks.rows import Row
from benchmarks.subjects import Subject, version_of

Figure = Callable[[Speeds], float]


@dataclass(frozen=True)
class Result:
    """What was measured for a row: per subject its runs, in the order in which they were interleaved."""

    row: Row
    runs: dict[str, list[Speeds]]

    def median(self, key: str, figure: Figure) -> float | None:
        """The median of a figure over the runs of a subject; None if it was not run."""
        runs = self.runs.get(key)
        return statistics.median(map(figure, runs)) if runs else None

    def ratio(self, key: str, figure: Figure, base: Figure | None = None, to: str = "agentspeak") -> float | None:
        """The median over neighbouring runs of what a subject did for each unit that ``to`` did."""
        ours, theirs = self.runs.get(key), self.runs.get(to)
        if not ours or not theirs:
            return None
        return statistics.median(figure(a) / (base or figure)(b) for a, b in zip(ours, theirs, strict=True))


def cold(speeds: Speeds) -> float:
    return speeds.cold


def warm(speeds: Speeds) -> float:
    return speeds.warm


def resident(speeds: Speeds) -> float:
    return speeds.rss


def report(results: list[Result], footprints: dict[str, dict[str, float]], subjects: list[Subject], repeat: int) -> str:
    """The whole document."""
    parts = [_HEAD.format(machine=_machine(subjects), repeat=repeat), _speed_table(results), ""]
    parts += [_jason_table(results), ""]
    if any(subject.key == "agentd --decisions" for subject in subjects):
        parts += [_records_table(results), ""]
    if any(subject.key == "jason" for subject in subjects):
        parts += [_jason_here(results), ""]
    if footprints:
        parts += [_footprint_table(footprints), ""]
    return "\n".join(parts)


_HEAD = """\
# The reasoner measured beside its peers

Written by `make bench-reasoner` (`python -m benchmarks.reasoner`); what it says is what was measured, on one machine:
{machine}.
Every program (`benchmarks/programs`) is run {repeat} times by each reasoner, in turns, in fresh processes. *Cold* is
the first round of a process, *warm* the median of its last two. Speeds are medians in operations per second, ratios
medians of the ratios of neighbouring runs. How the mind works, and where its time goes: [mind.md](mind.md).
"""


def _machine(subjects: list[Subject]) -> str:
    model = platform.machine()
    cores = 0
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                model, cores = " ".join(value.split()), cores + 1
    except OSError:
        pass
    described = f"{model}, {cores or '?'} cores, {platform.system()}, CPython {platform.python_version()}"
    peers = f"agentd {version_of('argosy')}, python-agentspeak {version_of('agentspeak')}"
    if any(subject.key == "jason" for subject in subjects):
        peers += ", and the `jason` command found here"
    return f"{described}; {peers}; {datetime.now(UTC):%Y-%m-%d}"


def _speed_table(results: list[Result]) -> str:
    lines = [
        "## Speed and memory beside python-agentspeak",
        "",
        "| row | one operation | agentd cold | warm | python-agentspeak cold | warm | ratio cold | ratio warm | target "
        "| peak RSS MB, agentd | python-agentspeak |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for result in results:
        row, ratio = result.row, result.ratio("agentd", warm)
        verdict = "" if ratio is None else " met" if ratio >= row.target else " **missed**"
        cells = [
            f"{row.key} {row.bench.split('_', 1)[1].replace('_', ' ')}",
            row.operation,
            _speed(result.median("agentd", cold)),
            _speed(result.median("agentd", warm)),
            _speed(result.median("agentspeak", cold)),
            _speed(result.median("agentspeak", warm)),
            _times(result.ratio("agentd", cold)),
            _times(ratio),
            f"{row.target:g}x{verdict}",
            _megabytes(result.median("agentd", resident)),
            _megabytes(result.median("agentspeak", resident)),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _jason_table(results: list[Result]) -> str:
    lines = [
        "## Beside Jason",
        "",
        "Jason 3.3 was measured elsewhere, on JRE 21, beside python-agentspeak 0.2.2: its column is the ratio found",
        "there, so that machines cancel out. Cold ratios here are first rounds over python-agentspeak's warm speed,",
        "which is what is known of Jason.",
        "",
        "| row | warm: agentd | Jason | | cold: agentd | Jason | | peak RSS: agentd / Jason | |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    ahead = {"warm": 0, "cold": 0, "memory": 0}
    for result in results:
        jason = result.row.jason
        if jason is None:
            continue
        warm_ratio, cold_ratio = result.ratio("agentd", warm), result.ratio("agentd", cold, warm)
        held = result.median("agentd", resident)
        share = held / jason.rss if held else None
        wins = (
            _ahead(warm_ratio, jason.warm_ratio),
            _ahead(cold_ratio, jason.cold_ratio),
            "" if share is None else "under a quarter" if share <= 0.25 else "**over a quarter**",
        )
        ahead["warm"] += wins[0] == "ahead"
        ahead["cold"] += wins[1] == "ahead"
        ahead["memory"] += wins[2] == "under a quarter"
        cells = [
            f"{result.row.key} {result.row.operation}",
            *(_times(warm_ratio), _times(jason.warm_ratio), wins[0]),
            *(_times(cold_ratio), _times(jason.cold_ratio), wins[1]),
            *("-" if share is None else f"{share:.0%}", wins[2]),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    known = sum(r.row.jason is not None for r in results)
    cold_known = sum(r.row.jason is not None and r.row.jason.cold is not None for r in results)
    lines += [
        "",
        f"Ahead of Jason's warm JVM on {ahead['warm']} of {known} rows, of its first round on {ahead['cold']} of "
        f"{cold_known}, within a quarter of its memory on {ahead['memory']} of {known}.",
    ]
    return "\n".join(lines)


def _ahead(ours: float | None, theirs: float | None) -> str:
    if ours is None or theirs is None:
        return ""
    return "ahead" if ours > theirs else "**behind**"


def _records_table(results: list[Result]) -> str:
    lines = [
        "## What decision records cost",
        "",
        "| row | records off, warm | records on, warm | cost | ratio to python-agentspeak with records on |",
        "|---|---|---|---|---|",
    ]
    for result in results:
        kept = result.ratio("agentd --decisions", warm, to="agentd")
        cells = [
            f"{result.row.key} {result.row.operation}",
            _speed(result.median("agentd", warm)),
            _speed(result.median("agentd --decisions", warm)),
            "-" if kept is None else f"{1 - kept:.0%}",
            _times(result.ratio("agentd --decisions", warm)),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _jason_here(results: list[Result]) -> str:
    lines = ["## Jason, run here", "", "| row | cold | warm | peak RSS MB |", "|---|---|---|---|"]
    for result in results:
        if "jason" in result.runs:
            figures = (result.median("jason", cold), result.median("jason", warm))
            memory = _megabytes(result.median("jason", resident))
            lines.append(f"| {result.row.key} | {' | '.join(map(_speed, figures))} | {memory} |")
    return "\n".join(lines)


def _footprint_table(footprints: dict[str, dict[str, float]]) -> str:
    lines = [
        "## Start and memory",
        "",
        "| | agentd | limit | records on | python-agentspeak | Jason, elsewhere |",
        "|---|---|---|---|---|---|",
    ]
    for footprint in FOOTPRINTS:
        found = footprints[footprint.title]
        digits = 2 if footprint.unit == "s" else 1
        ours = found["agentd"]
        verdict = "met" if ours < footprint.limit else "**missed**"
        others = [found.get(key) for key in ("agentd --decisions", "agentspeak")]
        shown = [f"{ours:.{digits}f} {footprint.unit}", f"{footprint.limit:g} {footprint.unit}, {verdict}"]
        shown += ["-" if value is None else f"{value:.{digits}f}" for value in [*others, footprint.jason]]
        lines.append(f"| {footprint.title} | {' | '.join(shown)} |")
    return "\n".join(lines)


def _speed(value: float | None) -> str:
    return "-" if value is None else f"{value:,.0f}"


def _times(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}x" if value < 100 else f"{value:,.0f}x"


def _megabytes(value: float | None) -> str:
    return "-" if value is None else f"{value:.0f}"
