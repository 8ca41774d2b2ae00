"""`argosy trial`: fly a mission many times in virtual time, each run by its seed, and judge every run."""

from __future__ import annotations

import os
import sys
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from argosy.cli.errors import BadInput
from argosy.trial.faults import Fault, draw, read
from argosy.trial.single_run import Outcome, Request
from argosy.trial.statistics import causes, mcnemar, quantiles, wilson
from argosy.trial.workers import workers
from commd.process.process import EXIT_DONE, EXIT_FAILED
from schemas.mission.model import Mission, load_mission

SEEDS_SHOWN = 5
"""Seeds that are named for each cause."""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy trial`."""
    parser.add_argument("mission", help="mission file")
    parser.add_argument("--runs", type=_count, default=100, metavar="N", help="number of runs (default: 100)")
    parser.add_argument("--seed", type=int, default=1, metavar="S", help="seed of the first run; the next has S + 1")
    parser.add_argument("--jobs", type=_count, default=os.cpu_count() or 1, metavar="J", help="runs at a time")
    parser.add_argument(
        "--faults",
        default="standard",
        metavar="NAME|FILE",
        help="standard (drawn by seed; the default), none, or a YAML file with a list of faults",
    )
    parser.add_argument("--replay", type=int, metavar="SEED", help="run one seed, and print its faults and its journal")
    parser.add_argument("--until", type=float, metavar="T", help="with --replay: stop after T virtual seconds")
    parser.add_argument("--shrink", action="store_true", help="with --replay: take faults away while it still fails")
    parser.add_argument("--compare", metavar="MISSION", help="run the same seeds on another mission, and compare")
    parser.add_argument("--min-success", type=_share, metavar="P", help="exit with 1 if fewer runs succeed (0 to 1)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="write report.txt and outcomes.json to this folder")


def _count(text: str) -> int:
    if (count := int(text)) < 1:
        raise ValueError
    return count


def _share(text: str) -> float:
    if not 0 <= (share := float(text)) <= 1:
        raise ValueError
    return share


_count.__name__, _share.__name__ = "number above 0", "share (0 to 1)"


def run(args: Namespace) -> int:
    """Run the trial. Returns the exit code: 0 unless fewer runs than wanted succeed, or the run of a seed fails."""
    mission = load_mission(args.mission)
    if args.replay is not None:
        return _replay(mission, args)
    outcomes = _run_all(mission, args)
    text = report(mission, outcomes)
    if args.compare is not None:
        other = _run_all(load_mission(args.compare), args)
        text += "\n" + comparison(args.mission, outcomes, args.compare, other)
    print(text)
    if args.out is not None:
        _write(args.out, text, outcomes)
    share = sum(one.success for one in outcomes) / len(outcomes)
    return EXIT_FAILED if args.min_success is not None and share < args.min_success else EXIT_DONE


def _faults(mission: Mission, args: Namespace, seed: int) -> tuple[Fault, ...]:
    match args.faults:
        case "none":
            return ()
        case "standard":
            return tuple(draw(mission, seed))
        case file:
            return tuple(read(Path(file), mission))


def _requests(mission: Mission, args: Namespace, seeds: Sequence[int]) -> list[Request]:
    path = str(mission.path.resolve())
    return [Request(path, seed, _faults(mission, args, seed)) for seed in seeds]


def _run_all(mission: Mission, args: Namespace) -> list[Outcome]:
    seeds = range(args.seed, args.seed + args.runs)
    done: list[Outcome] = []
    begun = time.monotonic()
    with workers(min(args.jobs, args.runs)) as run_all:
        for outcome in run_all(_requests(mission, args, seeds)):
            if outcome.why.startswith("bad input: "):
                raise BadInput(outcome.why.removeprefix("bad input: "))
            done.append(outcome)
            failed = sum(not one.success for one in done)
            if sys.stderr.isatty():
                left = (time.monotonic() - begun) / len(done) * (args.runs - len(done))
                print(
                    f"\r{len(done)} of {args.runs} runs, {failed} failed, {left:.0f} s left ", end="", file=sys.stderr
                )
    if sys.stderr.isatty():
        print(file=sys.stderr)
    return sorted(done, key=lambda one: one.seed)


def report(mission: Mission, outcomes: Sequence[Outcome]) -> str:
    """Return what the runs say, as text."""
    successes = sum(one.success for one in outcomes)
    violated = [one for one in outcomes if one.violations]
    lines = [
        f"{mission.fleet}: {successes} of {len(outcomes)} runs succeed: "
        f"{wilson(successes, len(outcomes))}, 95 % interval",
        f"safety: {len(violated)} runs with a violation",
    ]
    for cause in causes(outcomes):
        seeds = ", ".join(map(str, cause.seeds[:SEEDS_SHOWN])) + (", ..." if len(cause.seeds) > SEEDS_SHOWN else "")
        lines.append(f"  {len(cause.seeds):4} x {cause.text.splitlines()[0] if cause.text else '?'} (seeds {seeds})")
    lines.append(f"{'':16}{'median':>10}{'95 %':>10}{'most':>10}")
    good = [one for one in outcomes if one.success]
    rows = (
        ("duration (s)", [one.seconds for one in good]),
        ("flown (m)", [one.flown for one in good]),
        ("messages", [float(one.messages) for one in good]),
        ("apart (m)", [one.nearest for one in good if one.nearest is not None]),
    )
    for name, values in rows:
        if values:
            lines.append(f"{name:16}" + "".join(f"{value:10.1f}" for value in quantiles(values)))
    if any(one.nearest is not None for one in outcomes):
        lines.append(
            f"nearest approach of two vehicles: {min(o.nearest for o in outcomes if o.nearest is not None):.1f} m"
        )
    return "\n".join(lines)


def comparison(one: str, first: Sequence[Outcome], other: str, second: Sequence[Outcome]) -> str:
    """Return whether two missions differ over the same seeds, as text."""
    pairs = list(zip(first, second, strict=True))
    only_first = sum(a.success and not b.success for a, b in pairs)
    only_second = sum(b.success and not a.success for a, b in pairs)
    p = mcnemar(only_first, only_second)
    differ = "they differ" if p < 0.05 else "no difference is shown"
    return (
        f"{one} against {other}: {sum(a.success for a in first)} and {sum(b.success for b in second)} "
        f"of {len(pairs)} runs succeed; "
        f"in {only_first} only the first, in {only_second} only the second: {differ} (McNemar, p = {p:.3g})"
    )


def _replay(mission: Mission, args: Namespace) -> int:
    faults = _faults(mission, args, args.replay)
    with workers(1) as run_all:

        def again(tried: tuple[Fault, ...], journal: bool = False) -> Outcome:
            path = str(mission.path.resolve())
            return next(iter(run_all([Request(path, args.replay, tried, journal=journal, until=args.until)])))

        if args.shrink:
            faults = shrunk(faults, lambda tried: not again(tried).success)
        outcome = again(faults, journal=True)
    print("faults:" if faults else "no faults")
    for fault in faults:
        print(f"  {fault}")
    print("\n".join(outcome.journal))
    for violation in outcome.violations:
        print(f"{violation.at:8.1f} s  VIOLATION {violation.rule}: {violation.text}")
    print(f"seed {args.replay}: {'success' if outcome.success else f'failed: {outcome.why}'}; digest {outcome.digest}")
    return EXIT_DONE if outcome.success else EXIT_FAILED


def shrunk(faults: tuple[Fault, ...], fails: Callable[[tuple[Fault, ...]], bool]) -> tuple[Fault, ...]:
    """Return the faults without those that the failure does not need: one after the other is taken away."""
    if not fails(faults):
        return faults
    for fault in faults:
        fewer = tuple(one for one in faults if one is not fault)
        if fails(fewer):
            faults = fewer
    return faults


def _write(folder: Path, text: str, outcomes: Sequence[Outcome]) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "report.txt").write_text(text + "\n", encoding="utf-8")
        (folder / "outcomes.json").write_bytes(msgspec.json.format(msgspec.json.encode(list(outcomes)), indent=1))
    except OSError as error:
        raise BadInput(f"--out {folder}: {error.strerror}") from None
