"""The tables of docs/measurements/reasoner.md."""

from __future__ import annotations

from benchmarks.reasoner.elsewhere import ELSEWHERE
from benchmarks.reasoner.footprint import FOOTPRINTS
from benchmarks.reasoner.result import (
    Result,
    cold,
    resident,
    told_megabytes,
    told_share,
    told_speed,
    told_times,
    warm,
)


def tables(results: list[Result]) -> list[str]:
    """What was found of rows, each table under its heading."""
    run = {key for result in results for key in result.runs}
    found = [_speed_table(results), _jason_table(results)]
    if "jason" in run:
        found.append(_jason_here(results))
    if "agentd --decisions" in run:
        found.append(_records_table(results))
    return found


def ahead(results: list[Result]) -> tuple[int, int]:
    """Return on how many rows agentd is ahead of Jason's warm JVM, and of how many.

    What is compared are the ratios to python-agentspeak.
    """
    known = [(result.ratio("agentd", warm), result.row.jason) for result in results if result.row.jason is not None]
    return sum(_ahead(ours, jason.warm_ratio) == "ahead" for ours, jason in known if jason), len(known)


def _speed_table(results: list[Result]) -> str:
    lines = [
        "### Speed and memory beside python-agentspeak",
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
            told_speed(result.median("agentd", cold)),
            told_speed(result.median("agentd", warm)),
            told_speed(result.median("agentspeak", cold)),
            told_speed(result.median("agentspeak", warm)),
            told_times(result.ratio("agentd", cold)),
            told_times(ratio),
            f"{row.target:g}x{verdict}",
            told_megabytes(result.median("agentd", resident)),
            told_megabytes(result.median("agentspeak", resident)),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _jason_table(results: list[Result]) -> str:
    lines = [
        "### Beside Jason",
        "",
        f"{ELSEWHERE.origin.line()} Its column is the ratio to python-agentspeak that was found there, so that",
        "machines roughly cancel: what a compiler at run time gains over an interpreter differs from processor to",
        "processor. Cold ratios here are first rounds over python-agentspeak's warm speed, which is what is known of",
        "Jason.",
        f"Memory there: {ELSEWHERE.origin.memory}.",
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
            *(told_times(warm_ratio), told_times(jason.warm_ratio), wins[0]),
            *(told_times(cold_ratio), told_times(jason.cold_ratio), wins[1]),
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
        "### What decision records cost",
        "",
        "| row | records off, warm | records on, warm | cost | ratio to python-agentspeak with records on |",
        "|---|---|---|---|---|",
    ]
    for result in results:
        kept = result.ratio("agentd --decisions", warm, to="agentd")
        cells = [
            f"{result.row.key} {result.row.operation}",
            told_speed(result.median("agentd", warm)),
            told_speed(result.median("agentd --decisions", warm)),
            "-" if kept is None else f"{1 - kept:.0%}",
            told_times(result.ratio("agentd --decisions", warm)),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _jason_here(results: list[Result]) -> str:
    lines = [
        "### Jason, run here",
        "",
        "Without the percept rows, whose environment would have to be written in Java. The last column is agentd's",
        "warm speed over Jason's, and its memory over Jason's, of neighbouring runs.",
        "",
        "| row | Jason cold | warm | peak RSS MB | agentd / Jason |",
        "|---|---|---|---|---|",
    ]
    for result in results:
        if "jason" in result.runs:
            cells = [
                f"{result.row.key} {result.row.operation}",
                told_speed(result.median("jason", cold)),
                told_speed(result.median("jason", warm)),
                told_megabytes(result.median("jason", resident)),
                f"{told_times(result.ratio('agentd', warm, to='jason'))} the speed, "
                f"{told_share(result.ratio('agentd', resident, to='jason'))} of the memory",
            ]
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def footprint_table(footprints: dict[str, dict[str, float]]) -> str:
    """Start times and memory, under a heading."""
    here = any("jason" in found for found in footprints.values())
    heads = [
        "",
        "agentd",
        "limit",
        "records on",
        "python-agentspeak",
        "Jason, elsewhere",
        *(["Jason, here"] if here else []),
    ]
    lines = ["### Start and memory", "", f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for footprint in FOOTPRINTS:
        if (found := footprints.get(footprint.title)) is None:
            continue
        digits = 2 if footprint.unit == "s" else 1
        ours = found["agentd"]
        verdict = "met" if ours < footprint.limit else "**missed**"
        others = [found.get("agentd --decisions"), found.get("agentspeak"), footprint.jason]
        shown = [f"{ours:.{digits}f} {footprint.unit}", f"{footprint.limit:g} {footprint.unit}, {verdict}"]
        values = [*others, *([found.get("jason")] if here else [])]
        shown += ["-" if value is None else f"{value:.{digits}f}" for value in values]
        lines.append(f"| {footprint.title} | {' | '.join(shown)} |")
    return "\n".join(lines)
