"""The report of a trial as text, as JSON and as one page of HTML that needs no network: its pictures are inline SVG."""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any, Final

import msgspec

from argosy.cli.errors import BadInput
from argosy.plot.style import FAINT, GRID, INK, OUTCOMES, ROBOTS
from argosy.trial.single_run import Outcome
from argosy.trial.statistics import (
    Cause,
    Distribution,
    Interval,
    causes,
    distributions,
    fault_shares,
    histogram,
    mcnemar,
    quantiles,
    wilson,
)
from commd.process.state_dir import write_output
from schemas.humanize import columns, count, escape_line, shortened, span

SEEDS_SHOWN: Final = 5
"""Seeds that the text names for each cause; the page names all."""
DIFFERENT: Final = 0.05
"""p below which two missions count as different."""
WIDTH, HEIGHT = 300, 120
"""Pixels of a histogram."""
GOOD, BAD = ROBOTS[2], OUTCOMES["failed"][0]


@dataclass
class Trial:
    """What was run, and what became of it."""

    mission: str
    """As it was named on the command line."""
    faults: str
    """`standard`, `none` or the name of a file."""
    wanted: int
    """Runs that were asked for."""
    outcomes: list[Outcome]
    """Of the runs that are done, by seed."""
    wall: float = 0.0
    """Wall seconds."""

    @property
    def successes(self) -> int:
        """Runs that reached the mission's `done` and broke no rule."""
        return sum(one.success for one in self.outcomes)

    @property
    def violations(self) -> int:
        """Runs in which a checker found something."""
        return sum(bool(one.violations) for one in self.outcomes)

    @property
    def interval(self) -> Interval:
        """Share of successes and its 95 % interval. Raises ValueError for no runs."""
        return wilson(self.successes, len(self.outcomes))


@dataclass(frozen=True)
class Comparison:
    """Two missions over the same seeds and faults."""

    first: Trial
    second: Trial

    @property
    def only_first(self) -> list[int]:
        """Seeds with which only the first succeeds."""
        return self._only(True)

    @property
    def only_second(self) -> list[int]:
        """Seeds with which only the second succeeds."""
        return self._only(False)

    def _only(self, first: bool) -> list[int]:
        second = {one.seed: one.success for one in self.second.outcomes}
        return [a.seed for a in self.first.outcomes if a.success == first and second.get(a.seed) == (not first)]

    @property
    def p(self) -> float:
        """Of McNemar's test."""
        return mcnemar(len(self.only_first), len(self.only_second))

    def __str__(self) -> str:
        verdict = "they differ" if self.p < DIFFERENT else "no difference is shown"
        return (
            f"{self.first.mission} against {self.second.mission}: {self.first.successes} and {self.second.successes} "
            f"of {len(self.first.outcomes)} runs succeed; in {len(self.only_first)} only the first, in "
            f"{len(self.only_second)} only the second: {verdict} (McNemar, p = {self.p:.3g})"
        )


def text(trial: Trial, comparison: Comparison | None = None) -> str:
    """Return the report for a terminal."""
    done = len(trial.outcomes)
    if not done:
        return f"{trial.mission}: none of {trial.wanted} runs is done"
    lines = [
        f"{trial.mission}: {trial.successes} of {done} runs succeed: {trial.interval}, 95 % interval",
        f"safety: {count(trial.violations, 'run')} with a violation",
    ]
    if done < trial.wanted:
        lines.insert(0, f"interrupted: {done} of {trial.wanted} runs are done")
    lines += [f"  {len(cause.seeds):4} x {shortened(cause.text)} ({_seeds(cause)})" for cause in causes(trial.outcomes)]
    rows = [["", "least", "median", "95 %", "most"]]
    for one in distributions(trial.outcomes):
        rows.append([_title(one), *(f"{value:.1f}" for value in quantiles(one.values))])
    if len(rows) > 1:
        lines += columns(rows, right=(1, 2, 3, 4))
    if shares := fault_shares(trial.outcomes):
        table = [["faults drawn", "faults", "runs", "failed"]]
        table += [[one.kind, str(one.faults), str(one.runs), str(one.failed)] for one in shares]
        lines += columns(table, right=(1, 2, 3))
    if comparison is not None:
        lines.append(str(comparison))
    return "\n".join(map(escape_line, lines))


def _seeds(cause: Cause) -> str:
    more = ", ..." if len(cause.seeds) > SEEDS_SHOWN else ""
    word = "seed" if len(cause.seeds) == 1 else "seeds"
    return f"{word} {', '.join(map(str, cause.seeds[:SEEDS_SHOWN]))}{more}"


def _title(one: Distribution) -> str:
    return f"{one.name} ({one.unit})" if one.unit else one.name


def data(trial: Trial, comparison: Comparison | None = None) -> dict[str, Any]:
    """Return the report as plain data: sums first, then each run."""
    found: dict[str, Any] = {
        "mission": trial.mission,
        "faults": trial.faults,
        "runs": len(trial.outcomes),
        "wanted": trial.wanted,
        "successes": trial.successes,
        "violations": trial.violations,
        "interval": trial.interval._asdict() if trial.outcomes else None,
        "causes": [one._asdict() for one in causes(trial.outcomes)],
        "distributions": {
            one.name: dict(zip(("least", "median", "p95", "most"), quantiles(one.values), strict=True))
            | {"unit": one.unit}
            for one in distributions(trial.outcomes)
        },
        "faults_drawn": [one._asdict() for one in fault_shares(trial.outcomes)],
        "wall_seconds": round(trial.wall, 1),
        "outcomes": msgspec.to_builtins(trial.outcomes),
    }
    if comparison is not None:
        found["compare"] = {
            "only_first": comparison.only_first,
            "only_second": comparison.only_second,
            "p": comparison.p,
            "other": data(comparison.second),
        }
    return found


def write(folder: Path, trial: Trial, comparison: Comparison | None = None) -> None:
    """Write report.txt, outcomes.json and report.html, each as a whole. Raises BadInput if it cannot be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_output(folder / "report.txt", f"{text(trial, comparison)}\n".encode())
        encoded = msgspec.json.encode(data(trial, comparison))
        write_output(folder / "outcomes.json", msgspec.json.format(encoded, indent=1) + b"\n")
        write_output(folder / "report.html", page(trial, comparison).encode())
    except OSError as error:
        raise BadInput(f"--out {folder}: {error.strerror}") from None


_STYLE: Final = f"""\
body {{ font: 15px/1.45 system-ui, sans-serif; color: {INK}; max-width: 62rem; margin: 2rem auto; padding: 0 1rem }}
h1 {{ font-size: 1.5rem }} h2 {{ font-size: 1.1rem; margin-top: 2rem; border-bottom: 1px solid {GRID} }}
table {{ border-collapse: collapse }} td, th {{ text-align: left; padding: .25rem .8rem .25rem 0; vertical-align: top }}
th {{ color: {FAINT}; font-weight: normal; border-bottom: 1px solid {GRID} }} td.n, th.n {{ text-align: right }}
.big {{ font-size: 2rem }} .faint {{ color: {FAINT} }} .cells {{ display: flex; flex-wrap: wrap; gap: 1rem }}
figure {{ margin: 0 }} figcaption {{ color: {FAINT}; font-size: .85rem }} details td {{ font-size: .85rem }}
code {{ background: {GRID}; padding: 0 .25rem }}"""


def page(trial: Trial, comparison: Comparison | None = None) -> str:
    """Return the report as a page of HTML with nothing outside of it."""
    title = escape(f"Trial of {trial.mission}")
    body = "\n".join(_body(trial, comparison))
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{title}</title>\n'
        f"<style>\n{_STYLE}\n</style>\n</head>\n<body>\n<h1>{title}</h1>\n{body}\n</body>\n</html>\n"
    )


def _body(trial: Trial, comparison: Comparison | None) -> Iterator[str]:
    done = len(trial.outcomes)
    if not done:
        yield f"<p>None of {trial.wanted} runs is done.</p>"
        return
    seeds = f"seeds {trial.outcomes[0].seed} to {trial.outcomes[-1].seed}"
    early = f"; interrupted, {trial.wanted} were asked for" if done < trial.wanted else ""
    yield (
        f"<p class=faint>{count(done, 'run')}, {seeds}{early}; faults: {escape(trial.faults)}; "
        f"{escape(span(trial.wall))} of wall time</p>"
    )
    share, low, high = trial.interval
    yield f"<p><span class=big>{100 * share:.1f} %</span> of runs succeed ({trial.successes} of {done});"
    yield f"95 % interval (Wilson): {100 * low:.1f} to {100 * high:.1f} %</p>"
    yield _interval_picture(trial.interval)
    yield f"<p>{count(trial.violations, 'run')} with a violation of a safety rule.</p>"
    yield "<h2>Failures by cause</h2>"
    found = causes(trial.outcomes)
    rows = [[str(len(one.seeds)), escape(shortened(one.text)), ", ".join(map(str, one.seeds))] for one in found]
    yield _table(["runs", "cause (text of the first run)", "seeds"], rows, {0}) if rows else "<p>No run failed.</p>"
    if found:
        seed = found[0].seeds[0]
        command = f"argosy trial {trial.mission} --faults {trial.faults} --replay {seed}"
        yield f"<p>The first of them again, step by step: <code>{escape(command)}</code></p>"
    if measured := distributions(trial.outcomes):
        yield f"<h2>Runs that succeed</h2>\n<div class=cells>{''.join(map(_figure, measured))}</div>"
    yield from _fault_tables(trial.outcomes)
    if comparison is not None:
        yield f"<h2>Comparison</h2>\n<p>{escape(str(comparison))}</p>"
        seeds_of = [("only the first", comparison.only_first), ("only the second", comparison.only_second)]
        yield _table(["succeeds", "seeds"], [[name, ", ".join(map(str, them)) or "none"] for name, them in seeds_of])


def _fault_tables(outcomes: Sequence[Outcome]) -> Iterator[str]:
    shares = fault_shares(outcomes)
    yield "<h2>Faults</h2>"
    if not shares:
        yield "<p>No faults.</p>"
        return
    rows = [[escape(one.kind), str(one.faults), str(one.runs), str(one.failed)] for one in shares]
    yield _table(["kind", "faults", "runs with it", "of these failed"], rows, {1, 2, 3})
    each = [
        [str(one.seed), "yes" if one.success else "no", "<br>".join(escape(str(fault)) for fault in one.faults)]
        for one in outcomes
    ]
    table = _table(["seed", "success", "faults"], each, {0})
    yield f"<details><summary>Faults of each run</summary>\n{table}\n</details>"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]], right: Container[int] = ()) -> str:
    def row(cells: Sequence[str], tag: str) -> str:
        marked = (f"<{tag}{' class=n' if place in right else ''}>{cell}</{tag}>" for place, cell in enumerate(cells))
        return f"<tr>{''.join(marked)}</tr>"

    return "\n".join(["<table>", row(head, "th"), *(row(one, "td") for one in rows), "</table>"])


def _interval_picture(interval: Interval) -> str:
    """Return a scale from 0 to 100 % with the interval as a bar, and the share as a mark."""
    wide, left = 600, 10

    def x(share: float) -> float:
        return left + wide * share

    ticks = "".join(
        f'<line x1="{x(at / 4):g}" y1="26" x2="{x(at / 4):g}" y2="30" stroke="{FAINT}"/>'
        f'<text x="{x(at / 4):g}" y="42" text-anchor="middle">{25 * at} %</text>'
        for at in range(5)
    )
    colour = GOOD if interval.share >= 0.5 else BAD
    return (
        f'<svg width="{wide + 5 * left}" height="48" viewBox="0 0 {wide + 5 * left} 48" role="img" '
        f'aria-label="share of successes and its interval" font-size="11" fill="{FAINT}">'
        f'<rect x="{left}" y="10" width="{wide}" height="16" fill="{GRID}"/>'
        f'<rect x="{x(interval.low):.1f}" y="10" width="{max(1.0, wide * (interval.high - interval.low)):.1f}" '
        f'height="16" fill="{colour}" fill-opacity="0.55"/>'
        f'<line x1="{x(interval.share):.1f}" y1="6" x2="{x(interval.share):.1f}" y2="30" stroke="{INK}" '
        f'stroke-width="2"/>{ticks}</svg>'
    )


def _figure(one: Distribution) -> str:
    """Return a small histogram with its quantiles below."""
    bins = histogram(one.values)
    low, high = bins[0][0], bins[-1][1]
    most = max(number for _, _, number in bins)
    base, top, left, right = HEIGHT - 18, 8, 34, 8
    inner = WIDTH - left - right
    width = inner / len(bins) if low < high else 12.0
    first = left if low < high else left + inner / 2 - width / 2
    bars = "".join(
        f'<rect x="{first + width * place + 0.5:.1f}" y="{base - (base - top) * number / most:.1f}" '
        f'width="{width - 1:.1f}" height="{(base - top) * number / most:.1f}" fill="{ROBOTS[0]}">'
        f"<title>{begin:.4g} to {end:.4g}: {count(number, 'run')}</title></rect>"
        for place, (begin, end, number) in enumerate(bins)
    )
    ends = f'<text x="{left}" y="{HEIGHT - 4}">{low:.4g}</text>' if low < high else ""
    ends += f'<text x="{WIDTH - right}" y="{HEIGHT - 4}" text-anchor="end">{high:.4g}</text>' if low < high else ""
    ends += (
        f'<text x="{left + inner / 2:g}" y="{HEIGHT - 4}" text-anchor="middle">{low:.4g}</text>' if low == high else ""
    )
    least, median, p95, largest = quantiles(one.values)
    return (
        f"<figure><b>{escape(_title(one))}</b><br>"
        f'<svg width="{WIDTH}" height="{HEIGHT}" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" '
        f'aria-label="{escape(one.name)}" font-size="11" fill="{FAINT}">'
        f'<text x="{left - 4}" y="{top + 8}" text-anchor="end">{most}</text>'
        f'<text x="{left - 4}" y="{base}" text-anchor="end">0</text>{bars}'
        f'<line x1="{left}" y1="{base}" x2="{WIDTH - right}" y2="{base}" stroke="{FAINT}"/>{ends}</svg>'
        f"<figcaption>least {least:.4g}, median {median:.4g}, 95 % {p95:.4g}, most {largest:.4g}</figcaption></figure>"
    )
