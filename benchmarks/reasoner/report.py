"""Make Markdown and a picture of the reasoner's results, for docs/measurements/reasoner.md and other pages."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from operator import attrgetter
from typing import Final

from benchmarks import plots
from benchmarks.parts import row, table
from benchmarks.processes import Speeds
from benchmarks.reasoner.instructions import GENERATED, Counted
from benchmarks.reasoner.rows import ELSEWHERE, FOOTPRINTS, ROWS, Row, row_called
from benchmarks.results import Origin

Figure = Callable[[Speeds], float]


@dataclass(frozen=True)
class Result:
    """What was measured for a row: per subject its runs, in the order in which they were interleaved."""

    row: str
    """Its key."""
    runs: dict[str, list[Speeds]]

    @property
    def of(self) -> Row:
        """The row itself."""
        return row_called(self.row)

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


cold: Final = attrgetter("cold")
warm: Final = attrgetter("warm")
resident: Final = attrgetter("rss")


def cell(value: float | None, kind: str = "") -> str:
    """Return a figure for a table: times `x`, a part of one `%`, or by itself."""
    if value is None:
        return "-"
    return f"{value:.0%}" if kind == "%" else f"{value:.1f}x" if kind == "x" and value < 100 else f"{value:,.0f}{kind}"


def tables(results: list[Result]) -> list[str]:
    """What was found of rows, each table under its heading."""
    run = {key for result in results for key in result.runs}
    found = [_speed_table(results), _jason_table(results)]
    if "agentd --decisions" in run:
        found.append(_records_table(results))
    return found


OF_JASON: Final = [row.key for row in ROWS if row.jason is not None]
"""Rows that Jason has run, too."""


def ahead(results: list[Result]) -> tuple[int, int, str]:
    """Return on how many rows agentd is ahead of Jason's warm JVM, of how many, and those behind, with both ratios.

    What is compared are the ratios to python-agentspeak.
    """
    behind = [
        f"{result.of.key} {cell(ours, 'x')} where Jason has {cell(result.of.jason.warm_ratio, 'x')}"
        for result in results
        if result.of.jason is not None
        and not (ours := result.ratio("agentd", warm) or 0.0) > result.of.jason.warm_ratio
    ]
    known = sum(result.of.jason is not None for result in results)
    return known - len(behind), known, ", ".join(behind)


def _speed_table(results: list[Result]) -> str:
    head = (
        "| row | one operation | agentd cold | warm | python-agentspeak cold | warm | ratio cold | ratio warm "
        "| target | peak RSS MB, agentd | python-agentspeak |"
    )
    rows = []
    for result in results:
        of, ratio = result.of, result.ratio("agentd", warm)
        verdict = "" if ratio is None else " met" if ratio >= of.target else " **missed**"
        speeds = [cell(result.median(key, figure)) for key in ("agentd", "agentspeak") for figure in (cold, warm)]
        ratios = cell(result.ratio("agentd", cold), "x"), cell(ratio, "x"), f"{of.target:g}x{verdict}"
        memory = (cell(result.median(key, resident)) for key in ("agentd", "agentspeak"))
        name = f"{of.key} {of.bench.split('_', 1)[1].replace('_', ' ')}"
        rows.append(row(name, of.operation, *speeds, *ratios, *memory))
    return "\n".join(["### Speed and memory beside python-agentspeak", "", *table(head, rows)])


def _jason_table(results: list[Result]) -> str:
    rows, wins = [], {"warm": 0, "cold": 0, "memory": 0}
    known = [(result, jason) for result in results if (jason := result.of.jason) is not None]
    for result, jason in known:
        warm_ratio, cold_ratio = result.ratio("agentd", warm), result.ratio("agentd", cold, warm)
        held = result.median("agentd", resident)
        share = held / jason.rss if held else None
        verdicts = {
            "warm": _ahead(warm_ratio, jason.warm_ratio),
            "cold": _ahead(cold_ratio, jason.cold_ratio),
            "memory": "" if share is None else "under a quarter" if share <= 0.25 else "**over a quarter**",
        }
        for what, verdict in verdicts.items():
            wins[what] += verdict in ("ahead", "under a quarter")
        ratios = (
            *(cell(warm_ratio, "x"), cell(jason.warm_ratio, "x"), verdicts["warm"]),
            *(cell(cold_ratio, "x"), cell(jason.cold_ratio, "x"), verdicts["cold"]),
        )
        name = f"{result.of.key} {result.of.operation}"
        rows.append(row(name, *ratios, cell(share, "%"), verdicts["memory"]))
    head = "| row | warm: agentd | Jason | | cold: agentd | Jason | | peak RSS: agentd / Jason | |"
    cold_known = sum(jason.cold is not None for _, jason in known)
    about = (
        f"{ELSEWHERE.origin.line()} Its column is the ratio to python-agentspeak that was found there: machines "
        "roughly cancel, but the gain of a compiler at run time over an interpreter differs from processor to "
        "processor. Cold ratios here are first rounds over python-agentspeak's warm speed, as for Jason. Memory there: "
        f"{ELSEWHERE.origin.memory}."
    )
    result_line = (
        f"Ahead of Jason's warm JVM on {wins['warm']} of {len(known)} rows, of its first round on {wins['cold']} of "
        f"{cold_known}, within a quarter of its memory on {wins['memory']} of {len(known)}."
    )
    return "\n".join(["### Beside Jason", "", about, "", *table(head, rows), "", result_line])


def _ahead(ours: float | None, theirs: float | None) -> str:
    if ours is None or theirs is None:
        return ""
    return "ahead" if ours > theirs else "**behind**"


def _records_table(results: list[Result]) -> str:
    head = "| row | records off, warm | records on, warm | cost | ratio to python-agentspeak with records on |"
    rows = []
    for result in results:
        kept = result.ratio("agentd --decisions", warm, to="agentd")
        off, on = (cell(result.median(key, warm)) for key in ("agentd", "agentd --decisions"))
        cost, ratio = cell(None if kept is None else 1 - kept, "%"), result.ratio("agentd --decisions", warm)
        rows.append(row(f"{result.of.key} {result.of.operation}", off, on, cost, cell(ratio, "x")))
    return "\n".join(["### What decision records cost", "", *table(head, rows)])


def footprint_table(footprints: dict[str, dict[str, float]]) -> str:
    """Start times and memory, under a heading."""
    heads = "|  | agentd | limit | records on | python-agentspeak | Jason, elsewhere |"
    lines = ["### Start and memory", "", *table(heads)]
    for footprint in FOOTPRINTS:
        if (found := footprints.get(footprint.title)) is None:
            continue
        digits = 2 if footprint.unit == "s" else 1
        ours = found["agentd"]
        verdict = "met" if ours < footprint.limit else "**missed**"
        others = [found.get("agentd --decisions"), found.get("agentspeak"), footprint.jason]
        shown = [f"{ours:.{digits}f} {footprint.unit}", f"{footprint.limit:g} {footprint.unit}, {verdict}"]
        shown += ["-" if value is None else f"{value:.{digits}f}" for value in others]
        lines.append(f"| {footprint.title} | {' | '.join(shown)} |")
    return "\n".join(lines)


PICTURE: Final = "![how many times the speed of python-agentspeak each row reaches](figures/reasoner.svg)"


def page(origin: Origin, results: list[Result], footprints: dict[str, dict[str, float]], repeat: int) -> str:
    """The block of docs/measurements/reasoner.md."""
    method = (
        f"Every program (`benchmarks/reasoner/programs`) is run {repeat} times by each reasoner, in turns, in fresh "
        "processes. *Cold* is the first round of a process, *warm* the median of its last two. Speeds are medians in "
        f"operations per second, ratios medians of the ratios of neighbouring runs."
    )
    return "\n\n".join([origin.line(), method, PICTURE, *tables(results), footprint_table(footprints)])


FEW: Final = 20
"""Instructions per cycle under which a module is not shown by itself."""


def instructions(origin: Origin, counted: Mapping[str, Counted]) -> str:
    """The block of docs/architecture/mind.md: what a cycle of the slowest rows takes, by module."""
    modules = dict.fromkeys(name for one in counted.values() for name, count in one.modules.items() if count >= FEW)
    titles = [f"{key}, {row_called(key).operation}" for key in counted]
    rows = table(f"| interpreter's instructions per cycle of a mind | {' | '.join(titles)} |")
    for name in sorted(modules, key=lambda name: -sum(one.modules.get(name, 0.0) for one in counted.values())):
        cells = [f"{one.modules[name]:,.0f}" if name in one.modules else "" for one in counted.values()]
        rows.append(f"| {name if name == GENERATED else f'`{name}`'} | {' | '.join(cells)} |")
    rest = [one.whole - sum(one.modules.get(name, 0.0) for name in modules) for one in counted.values()]
    rows.append(f"| others | {' | '.join(f'{value:,.0f}' for value in rest)} |")
    rows.append(f"| in all | {' | '.join(f'{one.whole:,.0f}' for one in counted.values())} |")
    return f"{origin.line()} Counts do not depend on the load.\n\n" + "\n".join(rows)


def in_short(results: list[Result], footprints: dict[str, dict[str, float]]) -> list[str]:
    """The rows of the README's table about the reasoner."""
    by_key = {result.row: ratio for result in results if (ratio := result.ratio("agentd", warm)) is not None}
    indexed = [by_key[key] for key in ("c", "c2") if key in by_key]
    others = [ratio for key, ratio in by_key.items() if key not in {"c", "c2"}]
    if not indexed or not others:
        return []
    won, known, _ = ahead(results)
    idle = next(one for one in FOOTPRINTS if one.title == "resident when idle")
    memory = footprints[idle.title]
    return [
        f"| thinking, warm | {min(others):.0f} to {max(others):.0f} times python-agentspeak, look-ups and joins at "
        f"least {min(indexed):,.0f} times; ahead of Jason 3.3's warm JVM on {won} of {known} rows, behind on "
        f"{known - won} | [measured](docs/measurements/reasoner.md) |",
        f"| memory, idle reasoner | {memory['agentd']:.0f} MB | python-agentspeak {memory['agentspeak']:.0f} MB, "
        f"Jason {idle.jason:g} MB ([measured](docs/measurements/reasoner.md)) |",
    ]


def picture(results: list[Result]) -> str:
    """How many times python-agentspeak's warm speed agentd reaches on each row, and Jason elsewhere."""
    shown = [(result.of, ratio) for result in results if (ratio := result.ratio("agentd", warm)) is not None]
    with plots.figure(height=0.7 + 0.33 * len(shown)) as (made, axes):
        places = range(len(shown))
        axes.barh(
            [-place for place in places], [ratio for _, ratio in shown], color=plots.COLOURS["agentd"], height=0.6
        )
        known = [(place, row.jason.warm_ratio) for place, (row, _) in enumerate(shown) if row.jason is not None]
        axes.plot([x for _, x in known], [-place for place, _ in known], "D", color=plots.COLOURS["paper"], ms=5)
        for place, (row, _) in enumerate(shown):
            axes.plot([row.target] * 2, [-place - 0.4, -place + 0.4], color="black", lw=1)
        axes.set_xscale("log")
        axes.axvline(1, color="black", lw=0.5)
        axes.set_yticks([-place for place in places], [f"{row.key} {row.operation}" for row, _ in shown])
        axes.set_xlabel("times python-agentspeak's speed; diamond: Jason 3.3, elsewhere; line: asked for")
        axes.grid(visible=False, axis="y")
        return plots.svg(made)
