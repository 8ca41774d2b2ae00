"""Part `earlier`: the costs of other parts beside an earlier revision of the product, in one run.

The tree of that revision is taken from git and gets today's benchmarks, so that both run the same probes (`probe` of
each part) in turn, in alternating order. A ratio is the median over neighbouring runs.

    python -m benchmarks.earlier loop mail --pairs 6 --revision HEAD~3       some probes; nothing is written
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import msgspec

from benchmarks.parts import PARTS, Goal, progress, table
from benchmarks.processes import LONGEST, BenchmarkFailed, lines, started
from benchmarks.results import ROOT, Origin
from benchmarks.spread import Interval, interval

REVISION: Final = "89e0276"
"""The last revision before mail of neighbours moved in one process, and the first that today's benchmarks can drive."""
PAIRS: Final = {
    "reasoner": 2,
    "loop": 2,
    "footprint": 1,
    "bridge": 2,
    "mail": 2,
    "crowd": 1,
    "scale": 1,
    "startup": 1,
    "usage": 1,
}
"""How often each probe runs in both trees."""
LIMIT: Final = 1.05
"""Times the earlier cost that a cost may have."""
REASONS: Final = {
    "loop": "since 6d77f07 an agent that is kept on disk syncs each action before it starts, which a power failure had "
    "made it forget; by that alone its p50 is 1.13 times that of the revision before; tried: the bridge syncs ends in "
    "a thread",
    "scale": "since ec48f6b8 a busy link is read in 100 passes a second, to save wake-ups: a datagram may wait 10 ms "
    "for the next one; how much of it that makes is not known",
    "bridge": "reason not known; tried: daemons that wake at different moments (no difference)",
    "mail": "single pairs differ by a fifth; tried: 40,000 messages each in five turns by processor time of the three "
    "commd (0.80 to 1.05 times), and the revision before deliveries became tasks (f9738bbc, no difference)",
    "startup": "of more that is imported, ctypes (threads of Zenoh's keep their state) is the only package of others; "
    "tried: four pairs under a real-time scheduler beside other work: bridged took 1.02 to 1.41 times as long, "
    "the others were on both sides of 1",
}
"""What is known of why a probe costs more."""
_TODAYS: Final = ("benchmarks", "tests/support")
"""What the earlier tree has from today."""


@dataclass
class Costs:
    """One figure of a probe, by run: less is better."""

    then: list[float] = field(default_factory=list)
    now: list[float] = field(default_factory=list)

    def ratio(self) -> Interval:
        """Return now / then of neighbouring runs."""
        return interval([now / then for then, now in zip(self.then, self.now, strict=True)])


@dataclass
class Figures:
    """What the part measures."""

    revision: str = REVISION
    probes: dict[str, dict[str, Costs]] = field(default_factory=dict)
    """Of each probe its figures by title; the unit of a figure is in brackets at the end of its title."""


def measure(quick: bool) -> Figures:
    """Run each probe in both trees. Raises BenchmarkFailed."""
    return compare(REVISION, dict.fromkeys(("bridge", "crowd"), 1) if quick else PAIRS, quick)


def compare(revision: str, pairs: Mapping[str, int], quick: bool) -> Figures:
    """Run some probes so often in the tree of a revision and in this one. Raises BenchmarkFailed."""
    figures = Figures(revision, {name: {} for name in pairs})
    with trees(revision) as (earlier, today):
        for number in range(max(pairs.values())):
            for name in (name for name, count in pairs.items() if number < count):
                progress(f"{name}, pair {number + 1} of {pairs[name]}")
                order = (earlier, today) if number % 2 == 0 else (today, earlier)
                found = {where: run_probe(where, name, quick) for where in order}
                for title, then in found[earlier].items():
                    costs = figures.probes[name].setdefault(title, Costs())
                    costs.then.append(then)
                    costs.now.append(found[today][title])
    return figures


@contextmanager
def trees(revision: str) -> Iterator[tuple[Path, Path]]:
    """Yield two folders: the files of a revision with today's benchmarks, and today's files. Raises BenchmarkFailed.

    Today's files are copied too, so that both trees are alike in place and byte code, and work can go on meanwhile.
    """
    with tempfile.TemporaryDirectory(prefix="argosy-earlier-") as made:
        then, now = Path(made) / "then", Path(made) / "now"
        archive = Path(made) / "then.tar"
        try:
            _git("archive", "--output", str(archive), revision)
        except (OSError, subprocess.SubprocessError) as error:
            raise BenchmarkFailed(
                f"revision {revision} is not in this clone ({getattr(error, 'stderr', '').strip() or error}); "
                "a clone has its whole history after `git fetch --unshallow`, a copy without .git has none"
            ) from None
        shutil.unpack_archive(archive, then, filter="data")
        for file in _git("ls-files", "--cached", "--others", "--exclude-standard").splitlines():
            if (ROOT / file).is_file():
                (now / file).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / file, now / file)
        for folder in _TODAYS:
            shutil.rmtree(then / folder)
            shutil.copytree(now / folder, then / folder)
        if (named_then := then / "manifests" / "arducopter.toml").is_file():
            shutil.copy2(named_then, named_then.with_name("copter.toml"))  # today's benchmarks name it so
        bus, stamp = then / "commd/bus/bus.py", "stamp: Callable[[], int]"  # today's benchmarks give none
        bus.write_text(bus.read_text().replace(f"{stamp},", f'{stamp} = __import__("time").time_ns,'))
        # otherwise each process that is started there would compile everything
        subprocess.run([sys.executable, "-m", "compileall", "-q", "-x", "/tests/", str(then), str(now)], check=False)
        yield then, now


def _git(*arguments: str) -> str:
    return subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, timeout=60, check=True).stdout


def run_probe(where: Path, name: str, quick: bool) -> dict[str, float]:
    """Run a probe with the product and the benchmarks of a folder. Raises BenchmarkFailed."""
    # daemons are started with -P, without their folder on the path: they find its packages by PYTHONPATH alone
    part = next(one for one in PARTS if one.name == name)
    options = ("--probe", *(["--quick"] if quick else []))
    module = (sys.executable, "-m", "benchmarks.apart", part.name, part.where, *options)
    with started(["env", "-C", str(where), f"PYTHONPATH={where}", *module]) as process:
        printed = list(lines(process, LONGEST))
    for line in printed:
        if line.startswith("FOUND "):
            return msgspec.json.decode(line[6:], type=dict[str, float])
    raise BenchmarkFailed(f"probe {name} in {where.name}: " + "\n".join(printed[-3:]))


def goals(figures: Figures) -> list[Goal]:
    """Return one goal for each probe: none of its figures may be more than 5 % worse."""
    return [_goal(name, figures.revision, found) for name, found in figures.probes.items()]


def _goal(name: str, revision: str, found: Mapping[str, Costs]) -> Goal:
    ratios = {title: costs.ratio() for title, costs in found.items()}
    worst = max(ratios, key=lambda title: ratios[title].median)
    worse = [title for title, ratio in ratios.items() if ratio.median > LIMIT]
    certain = [title for title in worse if ratios[title].low > LIMIT]
    return Goal(
        f"{name}: each cost beside {revision}",
        f"at most {LIMIT:g} times",
        f"{ratios[worst].median:.3f} ({worst})",
        not worse,
        f"more than that: {', '.join(certain or worse)}; {REASONS.get(name, 'reason not known')}"
        + ("" if certain else "; other pairs of runs were within it; tried: pairs in changing order"),
        bool(certain) or not worse,
    )


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the block of docs/measurements/benchmarks.md."""
    return {"earlier": "\n".join([origin.line(), "", *cost_rows(figures)])}


def cost_rows(figures: Figures) -> list[str]:
    """Return the rows of a table: each cost then and now, and their ratio."""
    rows = [*table(f"| | {figures.revision} | now | now / then: median (least to greatest) | |")]
    for name, found in figures.probes.items():
        for title, costs in found.items():
            ratio = costs.ratio()
            verdict = "" if ratio.median <= LIMIT else "**worse**" if ratio.low > LIMIT else "not decided"
            rows.append(
                f"| {name}: {title} | {_figure(costs.then)} | {_figure(costs.now)} "
                f"| {ratio.median:.3f} ({ratio.low:.3f} to {ratio.high:.3f}) | {verdict} |"
            )
    return rows


def _figure(runs: list[float]) -> str:
    median = interval(runs).median
    return f"{median:,.0f}" if median >= 1000 else f"{median:.3g}"


def main() -> int:
    """Compare some probes, and print the table. Returns the exit code: 1 when a probe failed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.earlier")
    parser.add_argument("probes", nargs="*", choices=[*PAIRS, []], help="all of them if none is named")
    parser.add_argument("--revision", default=REVISION, help="default: %(default)s")
    parser.add_argument("--pairs", type=int, help="runs in each tree; default: 1 to 3")
    parser.add_argument("--quick", action="store_true", help="only try it")
    args = parser.parse_args()
    pairs = {name: args.pairs or count for name, count in PAIRS.items() if name in (args.probes or PAIRS)}
    try:
        print("\n".join(cost_rows(compare(args.revision, pairs, args.quick))))
    except BenchmarkFailed as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
