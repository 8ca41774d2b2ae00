"""Fly the missions that ship with standard faults in virtual time, 1,000 seeds of each: no safety rule may be broken.

    python -m tests.soak.trials [--runs 1000] [--jobs 2] [--keep FOLDER] [MISSION ...]

FOLDER keeps each outcome of a revision as a line of JSON: a seed that is there is not flown again. Ctrl-C ends with
what is done.
Writes a section of docs/measurements/soak.md for each mission.
"""

import argparse
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

import msgspec

from argosy.trial.command import Progress
from argosy.trial.faults import draw
from argosy.trial.report import Trial, text
from argosy.trial.single_run import Outcome, Request
from argosy.trial.workers import workers
from benchmarks.results import revision
from schemas.mission.model import load_mission
from tests.soak.report import ROOT, write_section

RUNS = 1_000
MISSIONS = ("single_uav", "search_and_rescue")


def fly(mission: str, runs: int, jobs: int, kept: Path) -> list[Outcome]:
    """Fly the seeds 1 to `runs` that `kept` does not have yet, add them to it, and return the outcomes of all."""
    path = str(ROOT / "missions" / f"{mission}.yaml")
    team = load_mission(path)
    outcomes = [msgspec.json.decode(line, type=Outcome) for line in kept.open("rb")] if kept.exists() else []
    missing = sorted({*range(1, runs + 1)} - {one.seed for one in outcomes})
    progress = Progress(len(outcomes) + len(missing))
    with suppress(KeyboardInterrupt), workers(jobs) as run_all, kept.open("ab", buffering=0) as file:
        for outcome in run_all(Request(path, seed, tuple(draw(team, seed))) for seed in missing):
            file.write(msgspec.json.encode(outcome) + b"\n")
            outcomes.append(outcome)
            progress.show(outcomes)
            for violation in outcome.violations:
                print(f"{mission} seed {outcome.seed}: {violation.rule}: {violation.text}", flush=True)
    return sorted((one for one in outcomes if one.seed <= runs), key=lambda one: one.seed)


def main() -> int:
    """Run the soak. Returns the exit code: 1 if a safety rule was broken."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak.trials", description=__doc__)
    parser.add_argument("missions", nargs="*", default=MISSIONS, metavar="MISSION")
    parser.add_argument("--runs", type=int, default=RUNS)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--keep", type=Path, help="keep the outcomes here")
    args = parser.parse_args()
    broken = False
    with tempfile.TemporaryDirectory() as temporary:
        folder = (args.keep or Path(temporary)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        for mission in args.missions:
            outcomes = fly(mission, args.runs, args.jobs, folder / f"{mission}-{revision()}.jsonl")
            trial = Trial(f"missions/{mission}.yaml", "standard", args.runs, outcomes)
            cpu = sum(one.cpu for one in outcomes) / max(1, len(outcomes))
            lines = [
                f"`python -m tests.soak.trials --runs {args.runs} --jobs {args.jobs} {mission}`, at {revision()}: "
                f"{cpu:.2f} s of processor time a run.",
                *("", "```text", text(trial), "```"),
            ]
            print("\n".join(lines))
            if args.runs >= RUNS:
                write_section(f"Trials of {mission} with standard faults", lines)
            broken |= trial.violations > 0 or not all(one.digest for one in outcomes)  # one that hung or died has none
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
