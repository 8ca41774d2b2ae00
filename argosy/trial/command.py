"""`argosy trial`: fly a mission many times in virtual time, each run by its seed, and judge every run."""

from __future__ import annotations

import os
import sys
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryFile
from typing import Final

from argosy.check.command import check_mission
from argosy.cli.arguments import count
from argosy.cli.errors import BadInput, progress
from argosy.cli.extras import install_command
from argosy.processes.simulators import ON_MAVLINK, vehicle_of
from argosy.trial.faults import Fault, draw, read
from argosy.trial.process import SIMULATED
from argosy.trial.report import Comparison, Trial, text, write
from argosy.trial.single_run import Outcome, Request
from argosy.trial.statistics import cause_of, causes, same_cause
from argosy.trial.worker import ENOUGH
from argosy.trial.workers import workers
from bridged.bridge.robot_setup import prepare
from commd.process.command_line import finite_number
from commd.process.process import EXIT_DONE, EXIT_FAILED
from schemas.files.findings import Finding, Findings
from schemas.humanize import printable, span
from schemas.mission.model import Mission

DRIVERS: Final = ("mavlink", "zenoh")
"""Drivers whose input and output a trial has in virtual time."""
EXIT_INTERRUPTED: Final = 130
SECONDS: Final = finite_number(lambda number: number > 0, "number of seconds above 0")
SHARE: Final = finite_number(lambda number: 0 <= number <= 1, "share (0 to 1)")


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy trial`."""
    parser.add_argument("mission", help="mission file")
    parser.add_argument("--runs", type=count, default=100, metavar="N", help="number of runs (default: 100)")
    parser.add_argument(
        "--seed", type=int, default=1, metavar="S", help="seed of the first run (default: 1); the next has S + 1"
    )
    parser.add_argument("--jobs", type=count, metavar="J", help="runs at the same time (default: one per core)")
    parser.add_argument(
        "--faults",
        default="standard",
        metavar="NAME|FILE",
        help="standard (drawn by seed; the default), none, or a YAML file with a list of faults",
    )
    parser.add_argument("--replay", type=int, metavar="SEED", help="run one seed, and print its faults and its journal")
    parser.add_argument(
        "--until",
        type=SECONDS,
        metavar="T",
        help="with --replay: stop after T virtual seconds; exit code 1 if it failed before",
    )
    parser.add_argument(
        "--run-timeout",
        type=SECONDS,
        default=ENOUGH,
        metavar="S",
        help=f"wall seconds after which a run counts as hung and is ended (default: {ENOUGH:g})",
    )
    parser.add_argument(
        "--shrink", action="store_true", help="with --replay: remove the faults that the failure does not need"
    )
    parser.add_argument("--compare", metavar="MISSION", help="run the same seeds on another mission, and compare")
    parser.add_argument(
        "--min-success", type=SHARE, metavar="P", help="exit with 1 if a smaller share of runs succeeds (0 to 1)"
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="write report.html, report.txt and outcomes.json to this folder; with --replay: seed-SEED.mcap",
    )


def run(args: Namespace) -> int:
    """Run the trial. Returns the exit code: 0 unless fewer runs than wanted succeed, or the run of a seed fails."""
    if args.replay is None and (args.until is not None or args.shrink):
        raise BadInput(f"{'--until' if args.until is not None else '--shrink'}: only with --replay SEED")
    if args.replay is not None and args.compare is not None:
        raise BadInput("--compare: not with --replay, which is one run")
    mission = _mission(args.mission)
    compared = _mission(args.compare) if args.compare is not None else None
    if args.out is not None:
        _make_folder(args.out)
    if args.replay is not None:
        return _replay(mission, args)
    _faults(mission, args, args.seed)  # says what is wrong with them before anything starts
    trial, comparison = Trial(args.mission, args.faults, args.runs, []), None
    _run_all(mission, args, trial)
    if compared is not None and len(trial.outcomes) == args.runs:
        comparison = Comparison(trial, Trial(args.compare, args.faults, args.runs, []))
        _run_all(compared, args, comparison.second)
    print(text(trial, comparison))
    if args.out is not None:
        write(args.out, trial, comparison)
    if len(trial.outcomes) < args.runs or (comparison is not None and len(comparison.second.outcomes) < args.runs):
        return EXIT_INTERRUPTED
    share = trial.successes / len(trial.outcomes)
    return EXIT_FAILED if args.min_success is not None and share < args.min_success else EXIT_DONE


def _mission(path: str) -> Mission:
    """Return a mission that can be tried. Raises Findings with everything that is wrong with it."""
    mission, findings = check_mission(path, restarts=True)
    errors = [one for one in findings if one.severity == "error"]
    if mission is None or errors:
        raise Findings(errors or findings)
    if refused := list(refusals(mission)):
        raise Findings(refused)
    return mission


def refusals(mission: Mission) -> Iterator[Finding]:
    """Yield why a mission, which is free of errors, cannot be tried: it has other edges than a trial."""
    at = mission.positions.finding
    if mission.secured:
        yield at(("security",), "`security`: a trial has no TLS; expected a mission without it")
    if mission.gateway is not None:
        yield at(("gateway",), "`gateway`: a trial has no sockets for Comm nodes; expected a mission without it")
    if mission.router.external:
        yield at(("router",), "`external: true`: a trial has a network of its own; expected the boards' own routers")
    for name, robot in mission.robots.items():
        vehicle = vehicle_of(robot)
        if robot.simulate is None:
            yield at(("robots", name), f"{name} has no `simulate`: a trial has simulated robots alone")
            continue
        drivers = prepare(mission, name, None, 1.0)[1].manifest.drivers()
        if others := [one for one in drivers if one not in DRIVERS]:
            text = f"{name} uses driver {', '.join(others)}, which has its own clock; a trial has {', '.join(DRIVERS)}"
            yield at(("robots", name, "manifest"), text)
        if vehicle not in SIMULATED:
            yield at(
                ("robots", name, "simulate"),
                f"{name} simulates {vehicle or 'itself by its driver'}: expected `vehicle` to be one of "
                f"{', '.join(SIMULATED)}, which a trial has in virtual time",
            )
        elif vehicle in ON_MAVLINK and robot.link and not robot.link.startswith("udp"):
            yield at(("robots", name, "link"), f"{name} has link {robot.link}: expected udpin: or udpout: in a trial")


def _make_folder(out: Path) -> None:
    """Make the folder of the results, before the first run. Raises BadInput if it cannot be written."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        TemporaryFile(dir=out).close()
    except OSError as error:
        raise BadInput(f"--out {out}: {error.strerror}") from None


def _faults(mission: Mission, args: Namespace, seed: int) -> tuple[Fault, ...]:
    """Return the faults of a run. Raises Findings or BadInput for a file that does not fit."""
    match args.faults:
        case "none":
            return ()
        case "standard":
            return tuple(draw(mission, seed))
        case file:
            if not Path(file).exists():
                raise BadInput(f"--faults {file}: no such file; expected `standard`, `none` or a YAML list of faults")
            return tuple(read(Path(file), mission))


def _requests(mission: Mission, args: Namespace) -> Iterator[Request]:
    path = str(mission.path.resolve())
    named = None if args.faults == "standard" else _faults(mission, args, args.seed)
    for seed in range(args.seed, args.seed + args.runs):
        yield Request(path, seed, _faults(mission, args, seed) if named is None else named)


def _run_all(mission: Mission, args: Namespace, trial: Trial) -> None:
    """Run all seeds, and put the outcomes into the trial by their seeds. Ctrl-C ends all runs that are under way."""
    shown = Progress(args.runs)
    try:
        jobs = min(args.jobs or len(os.sched_getaffinity(0)), args.runs)
        with workers(jobs, args.run_timeout) as run_all:
            for outcome in run_all(_requests(mission, args)):
                _refuse(outcome)
                trial.outcomes.append(outcome)
                shown.show(trial.outcomes)
    except KeyboardInterrupt:
        pass  # the report says how many are done
    finally:
        progress("")
        trial.outcomes.sort(key=lambda one: one.seed)
        trial.wall = time.monotonic() - shown.begun


def _refuse(outcome: Outcome) -> None:
    if outcome.bad_input:
        raise BadInput(outcome.why)


@dataclass
class Progress:
    """How many runs are done, and what has failed so far: one line on a terminal, elsewhere a line each minute."""

    wanted: int
    begun: float = field(default_factory=time.monotonic)
    every: float = 60.0
    """Seconds between two lines where there is no terminal."""
    _lines: int = 0

    def show(self, outcomes: Sequence[Outcome]) -> None:
        """Draw the line again, or print one if it is due."""
        seconds = time.monotonic() - self.begun
        if not progress(self.line(outcomes, seconds)) and (
            seconds >= (self._lines + 1) * self.every and len(outcomes) < self.wanted
        ):
            self._lines = int(seconds / self.every)
            print(self.line(outcomes, seconds), file=sys.stderr, flush=True)

    def line(self, outcomes: Sequence[Outcome], seconds: float) -> str:
        """Return the line after some wall seconds."""
        left = span(seconds / len(outcomes) * (self.wanted - len(outcomes)))
        failed = sum(not one.success for one in outcomes)
        why = "; ".join(f"{len(one.seeds)} x {printable(one.text)}" for one in causes(outcomes))
        return f"{len(outcomes)} of {self.wanted} runs, {left} left, {failed} failed" + (f": {why}" if why else "")


def _replay(mission: Mission, args: Namespace) -> int:
    recording = _recording(args)
    faults = _faults(mission, args, args.replay)
    with workers(1, args.run_timeout) as run_all:

        def again(tried: tuple[Fault, ...], record: str = "", journal: bool = False) -> Outcome:
            path = str(mission.path.resolve())
            request = Request(path, args.replay, tried, journal=journal, until=args.until, record=record)
            outcome = next(iter(run_all([request])))
            _refuse(outcome)
            return outcome

        if args.shrink and (first := again(faults)).failed:
            faults = shrunk(faults, lambda tried: same_cause(first, again(tried)))
        outcome = again(faults, record=recording, journal=True)
    print("faults:" if faults else "no faults")
    for fault in faults:
        print(f"  {fault}")
    print("\n".join(outcome.journal))
    for violation in outcome.violations:
        print(f"{violation.at:8.1f} s  VIOLATION {violation.rule}: {violation.text}")
    ended = f"failed: {cause_of(outcome)}" if outcome.failed else outcome.why or "success"
    print(f"seed {args.replay}: {ended}; digest {outcome.digest}")
    if recording and Path(recording).exists():
        print(f"recording: {args.out / Path(recording).name}")
    return EXIT_FAILED if outcome.failed else EXIT_DONE


def _recording(args: Namespace) -> str:
    """Return the absolute path of the recording of a replay; empty: none is wanted. Raises BadInput."""
    if args.out is None:
        return ""
    if find_spec("mcap") is None:
        raise BadInput(f"--out with --replay writes a recording: it needs `{install_command('record')}`")
    return str((args.out / f"seed-{args.replay}.mcap").resolve())


def shrunk(faults: tuple[Fault, ...], fails: Callable[[tuple[Fault, ...]], bool]) -> tuple[Fault, ...]:
    """Return the faults without those that the failure does not need: one after the other is taken away."""
    for fault in faults:
        fewer = tuple(one for one in faults if one is not fault)
        if fails(fewer):
            faults = fewer
    return faults
