"""Fly the first mission by real processes over Zenoh at real speed, and in virtual time: do the two agree?

    python -m tests.soak.agreement [--flights 20] [--trials 200] [--jobs 2] [--keep FOLDER]

Both leave recordings, and these are compared: how long the mission and each action take, and in which order each agent
acts, decides and believes. What is in FOLDER already is not flown again. Writes its section of
docs/measurements/soak.md.
"""

import argparse
import asyncio
import statistics
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from agentd.conversion.mind_view import EVERYTHING, MindViews
from agentd.replay.replayed_mind import ReplayedMind
from argosy.recording.reader import Recording
from argosy.trial.single_run import Request
from argosy.trial.workers import workers
from schemas.wire.mind_records import MindDecisions
from schemas.wire.records import ActionStatus, Perception
from tests.soak.report import ROOT, table, write_section
from tests.soak.watched_run import watched
from tests.support.ports import free_port, neighbouring_ports

FLIGHTS, TRIALS = 20, 200
MISSION = ROOT / "missions" / "single_uav.yaml"
PATIENCE = 300.0
"""Wall seconds of one flight, which takes about 90."""
NEAR = 0.05
"""Share by which the medians of a duration may differ."""
WHOLE, HEARD = "mission, from the first action to the end of the last", "vehicle heard first, to the first action"
_LATE_START = (
    "a real process takes longer to start than the 0.3 s of a trial, so that the copter, which boots for 4 s, is "
    "nearer to ready when its agent acts"
)
EXPLAINED = {
    HEARD: _LATE_START,
    "set_mode": _LATE_START,
    "arm_motors": _LATE_START,
    "takeoff": "the motors spool up for 3.3 s from arming on (`SPOOL_UP_S` of the simulated copter), and lift off no "
    "sooner: the later arming is confirmed, the less of that is left for the takeoff",
}
"""Why durations differ by more."""


@dataclass
class Course:
    """What a recording says of one flight."""

    seconds: dict[str, float] = field(default_factory=dict)
    """How long the mission and each action took."""
    orders: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """By what is ordered, and the agent: what came one after the other."""


def course_of(recording: Path) -> Course:
    """Read a recording of one flight."""
    course, read = Course(), Recording(recording)
    begun: dict[str, int] = {}
    orders: dict[str, list[str]] = {}
    ended = 0
    for message, status in read.typed(ActionStatus):
        acted = orders.setdefault(f"actions of {message.key.split('/')[2]}", [])
        if status.id not in begun:
            begun[status.id] = message.stamp
            acted.append(f"{status.name} {status.state}")
        if status.final:
            acted.append(f"{status.name} {status.state}")
            course.seconds[status.name] = (message.stamp - begun[status.id]) / 1e9
            ended = message.stamp
    first = min(begun.values())
    heard = min(message.stamp for message, percept in read.typed(Perception) if percept.parameters[1:2] == (True,))
    course.seconds |= {HEARD: (first - heard) / 1e9, WHOLE: (ended - first) / 1e9}
    for _, record in read.typed(MindDecisions):
        decided = orders.setdefault(f"decisions of {record.agent}", [])
        chosen = [(one.name, one.chosen.position) for one in record.decisions if one.chosen is not None]
        decided += [f"{name} at {Path(position).name}" for name, position in chosen]
    course.orders = {name: tuple(order) for name, order in orders.items()}
    for life in read.minds():
        lived, noted = ReplayedMind(life.batches[0]), dict[str, None]()
        views = MindViews(lived.mind)
        for batch in life.batches:
            lived.feed(batch)
            own = [one.text for one in views.view(EVERYTHING, lived.now).beliefs if "self" in one.sources]
            noted |= dict.fromkeys(one.partition("[")[0].partition("(")[0] for one in own)
        course.orders[f"beliefs of {life.agent}"] = tuple(noted)
    return course


async def fly_all(recordings: list[Path], jobs: int) -> None:
    """Fly by real processes at real speed, some at a time; a recording that is there is not flown again."""
    turn = asyncio.Semaphore(jobs)

    async def one(recording: Path) -> None:
        async with turn:
            await fly(recording)

    await asyncio.gather(*(one(path) for path in recordings if not path.exists()))


async def fly(recording: Path) -> None:
    """Fly once, and record it."""
    folder = recording.with_suffix("")
    folder.mkdir()
    mission = folder / MISSION.name
    text = MISSION.read_text(encoding="utf-8").replace("udpin:127.0.0.1:14550", f"udpin:127.0.0.1:{free_port()}")
    mission.write_text(text, encoding="utf-8")
    (folder / "single_uav").symlink_to(MISSION.with_suffix(""))
    router = f"tcp/127.0.0.1:{neighbouring_ports(2)[0]}"
    command = ("argosy", "run", str(mission), "--plain", "--speed", "1", "--router", router, "--record", str(recording))
    code = await watched(command, folder / "run.log", lambda line: None, PATIENCE)
    print(f"{recording.name}: exit code {code}", flush=True)


def try_all(recordings: list[Path], jobs: int) -> None:
    """Fly in virtual time without faults, each with a seed of its own; a recording that is there is not made again."""
    missing = [(seed, one) for seed, one in enumerate(recordings, 1) if not one.exists()]
    with workers(jobs) as run_all:
        for outcome in run_all(Request(str(MISSION), seed, record=str(one)) for seed, one in missing):
            if not outcome.success:
                print(f"seed {outcome.seed}: {outcome.why}", flush=True)


def compare(flown: Sequence[Course], tried: Sequence[Course]) -> tuple[list[str], list[str]]:
    """Return the lines of the report, and what differs without an explanation."""
    rows, wrong = [], []
    for name in dict.fromkeys((WHOLE, HEARD, *flown[0].seconds)):
        real, virtual = ([one.seconds.get(name, float("nan")) for one in courses] for courses in (flown, tried))
        ratio = statistics.median(virtual) / statistics.median(real)
        if not abs(ratio - 1) <= NEAR and name not in EXPLAINED:
            wrong.append(f"{name}: {ratio:.3f}")
        rows.append((name, _spread(real), _spread(virtual), f"{ratio:.3f}" if name != HEARD else ""))
    lines = ["Seconds, medians (least to most); what is not named is an action, from its first status to its last:", ""]
    lines += [*table(f"| {len(flown)} flights | {len(tried)} trials | ratio of the medians", rows), ""]
    lines += [f"{' and '.join(names)}: {why}." for why, names in _by_reason().items()]
    rows = []
    for what in dict.fromkeys(name for one in (*flown, *tried) for name in one.orders):
        real_orders, virtual_orders = (Counter(one.orders.get(what, ()) for one in them) for them in (flown, tried))
        most = real_orders.most_common(1)[0][0]
        if {*real_orders, *virtual_orders} != {most}:
            wrong.append(f"{what}: {real_orders} {virtual_orders}")
        steps = ", ".join(most) if len(most) <= 12 else f"{len(most)}, from {most[0]} to {most[-1]}"
        rows.append((what, f"{real_orders[most]} of {len(flown)}", f"{virtual_orders[most]} of {len(tried)}", steps))
    lines += ["", "The same one after the other, as in most flights:", ""]
    return [*lines, *table("| flights | trials | what", rows)], wrong


def _spread(values: Sequence[float]) -> str:
    return f"{statistics.median(values):.2f} ({min(values):.2f} to {max(values):.2f})"


def _by_reason() -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for name, why in EXPLAINED.items():
        found.setdefault(why, []).append(f"`{name}`" if name != HEARD else name)
    return found


def main() -> int:
    """Run the soak. Returns the exit code: 1 if something differs without an explanation."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak.agreement", description=__doc__)
    parser.add_argument("--flights", type=int, default=FLIGHTS)
    parser.add_argument("--trials", type=int, default=TRIALS)
    parser.add_argument("--jobs", type=int, default=2, help="flights at a time (default 2)")
    parser.add_argument("--keep", type=Path, help="keep recordings and logs here")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = (args.keep or Path(temporary)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        flown = [folder / f"flight-{number}.mcap" for number in range(1, args.flights + 1)]
        tried = [folder / f"seed-{number}.mcap" for number in range(1, args.trials + 1)]
        asyncio.run(fly_all(flown, args.jobs))
        try_all(tried, args.jobs)
        lines, wrong = compare(*([course_of(one) for one in them] for them in (flown, tried)))
    command = f"`python -m tests.soak.agreement --flights {args.flights} --trials {args.trials} --jobs {args.jobs}`"
    about = "real processes over Zenoh at speed 1, and in virtual time without faults (`argosy trial`)"
    lines = [f"{command}: `missions/{MISSION.name}` by {about}.", "", *lines]
    print("\n".join([*lines, *(f"DIFFERS: {one}" for one in wrong)]))
    if args.flights >= FLIGHTS and args.trials >= TRIALS:
        write_section("Flights and trials agree", lines)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
