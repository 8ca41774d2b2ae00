"""What was measured of the reasoner as Markdown and as a picture: the blocks of docs/measurements/reasoner.md and
other pages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from benchmarks import plots
from benchmarks.reasoner.footprint import FOOTPRINTS
from benchmarks.reasoner.instructions import GENERATED, Counted
from benchmarks.reasoner.result import Result, warm
from benchmarks.reasoner.rows import row_called
from benchmarks.reasoner.tables import ahead, footprint_table, tables
from benchmarks.results import Origin

PICTURE: Final = "![how many times the speed of python-agentspeak each row reaches](figures/reasoner.svg)"


def page(
    origin: Origin, results: list[Result], footprints: dict[str, dict[str, float]], repeat: int, jason: str
) -> str:
    """The block of docs/measurements/reasoner.md. `jason` is the version of the Jason that was run as well, if there
    was one."""
    here = f" The `jason` command found here was run as well: {jason}." if jason else ""
    method = (
        f"Every program (`benchmarks/reasoner/programs`) is run {repeat} times by each reasoner, in turns, in fresh "
        "processes. *Cold* is the first round of a process, *warm* the median of its last two. Speeds are medians in "
        f"operations per second, ratios medians of the ratios of neighbouring runs.{here}"
    )
    return "\n\n".join([origin.line(), method, PICTURE, *tables(results), footprint_table(footprints)])


FEW: Final = 20
"""Instructions per cycle under which a module is not shown by itself."""


def instructions(origin: Origin, counted: Mapping[str, Counted]) -> str:
    """The block of docs/architecture/mind.md: what a cycle of the slowest rows takes, by module."""
    modules = dict.fromkeys(name for one in counted.values() for name, count in one.modules.items() if count >= FEW)
    titles = [f"{key}, {row_called(key).operation}" for key in counted]
    rows = [
        f"| interpreter's instructions per cycle of a mind | {' | '.join(titles)} |",
        "|---" * (len(titles) + 1) + "|",
    ]
    for name in sorted(modules, key=lambda name: -sum(one.modules.get(name, 0.0) for one in counted.values())):
        cells = [f"{one.modules[name]:,.0f}" if name in one.modules else "" for one in counted.values()]
        rows.append(f"| {name if name == GENERATED else f'`{name}`'} | {' | '.join(cells)} |")
    rest = [one.whole - sum(one.modules.get(name, 0.0) for name in modules) for one in counted.values()]
    rows.append(f"| others | {' | '.join(f'{value:,.0f}' for value in rest)} |")
    rows.append(f"| in all | {' | '.join(f'{one.whole:,.0f}' for one in counted.values())} |")
    return f"{origin.line()} Counts do not depend on the load.\n\n" + "\n".join(rows)


COMPARED: Final = ("a", "b", "c", "d", "e", "f", "f2", "g", "h")
"""The rows that docs/measurements/comparison.md shows."""


def comparison(results: list[Result], footprints: dict[str, dict[str, float]]) -> str:
    """The block of docs/measurements/comparison.md about speed: some rows, how many there are, start and memory."""
    lines = [
        "| one operation | Argosy / python-agentspeak, warm | Jason / python-agentspeak, warm | |",
        "|---|---|---|---|",
    ]
    for result in results:
        row, ours = result.row, result.ratio("agentd", warm)
        if row.key in COMPARED and row.jason is not None and ours is not None:
            remark = "Jason is faster" if ours < row.jason.warm_ratio else ""
            if row.key == "c":
                remark = remark or "Argosy indexes arguments, the others walk through"
            lines.append(f"| {row.operation} | {_bare(ours)} | {_bare(row.jason.warm_ratio)} | {remark} |")
    won, known = ahead(results)
    shown = len(lines) - 2
    lines += [
        "",
        f"These are {shown} of {known} rows. Argosy is ahead of Jason's warmed-up JVM in {won} of the {known}, by the "
        "ratio to python-agentspeak, and behind in the others.",
        "",
        footprint_table(footprints).partition("\n\n")[2],
    ]
    return "\n".join(lines)


def in_short(results: list[Result], footprints: dict[str, dict[str, float]]) -> list[str]:
    """The rows of the README's table about the reasoner."""
    by_key = {result.row.key: ratio for result in results if (ratio := result.ratio("agentd", warm)) is not None}
    indexed = [by_key[key] for key in ("c", "c2") if key in by_key]
    others = [ratio for key, ratio in by_key.items() if key not in {"c", "c2"}]
    if not indexed or not others:
        return []
    won, known = ahead(results)
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
    shown = [(result.row, ratio) for result in results if (ratio := result.ratio("agentd", warm)) is not None]
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


def _bare(value: float) -> str:
    return f"{value:.1f}" if value < 100 else f"{value:,.0f}"
