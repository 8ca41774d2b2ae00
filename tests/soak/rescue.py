"""Search and rescue while daemons are killed (-9) or stopped and links are cut: does each victim get one buoy?

    python -m tests.soak.rescue [--runs 20] [--first 1] [--keep FOLDER]

Each run has a world and troubles of its own, by its number. Any daemon of any board may be killed, at any time and, by
aim, just when a rescuer is to drop its buoy, or stopped for a while; any link between two boards may be cut.
`argosy run` starts daemons again as the mission says. The referee judges by the simulators' logs alone. Writes its
section of docs/measurements/soak.md.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import random
import re
import signal
import sys
import tempfile
import time
from collections import Counter
from contextlib import AsyncExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path

from argosy.simulate.referee import Verdict, judge_run
from schemas.mission.model import load_mission
from tests.soak.report import ROOT, table, write_section
from tests.soak.watched_run import watched
from tests.support.ports import neighbouring_ports
from tests.support.relay import Relay

RUNS = 20
PATIENCE = 540.0
"""Wall seconds of one run; the mission's own timeout comes first."""
PAUSE = (4.0, 12.0)
"""Wall seconds between two troubles."""
CUT = (1.0, 40.0)
"""Wall seconds for which a link is cut."""
FREEZE = (1.0, 8.0)
"""Wall seconds for which a daemon is stopped."""
SHARES = {"kill": 0.55, "cut": 0.3, "freeze": 0.15}
"""Of the troubles."""
AIMED_SHARE = 0.35
"""Of the arrivals over a victim, those after which a daemon is killed."""
AIM = 0.6
"""Wall seconds after an arrival, in which leave is asked for, the buoy dropped and reported: the kill falls there."""
NORTH, HALF_WAY = "-27.602955", "-27.603404"
"""Of the mission's area, and of its southern half."""
MISSION = ROOT / "missions" / "search_and_rescue.yaml"
BOARDS = ("pi1", "pi2", "pi3")
_STARTED = re.compile(r"s  (?P<name>(?:commd|bridged|agentd) .*?): (?:re)?started, pid (?P<pid>\d+)")
_ARRIVES = re.compile(r"s  rescuer(?P<number>\d): goto\(.*succeeded after")


@dataclass
class Course:
    """What happened in a run."""

    number: int
    verdict: Verdict | None = None
    """None: it could not be judged."""
    code: int | None = None
    """Exit code of `argosy run`; None: it had to be ended."""
    seconds: float = 0.0
    troubles: Counter[str] = field(default_factory=Counter)
    diary: list[str] = field(default_factory=list)
    why: str = ""

    @property
    def good(self) -> bool:
        """Whether the mission was done, as it says itself and as the referee says."""
        return self.code == 0 and self.verdict is not None and self.verdict.good

    @property
    def judged(self) -> str:
        """The last line of the referee's verdict."""
        return str(self.verdict).splitlines()[-1] if self.verdict is not None else "not judged"


def write_mission(folder: Path, seed: int, links: list[int], victims: int | None = None) -> Path:
    """Write the mission with another world and other links to its vehicles; with so many victims in half its area."""
    text = MISSION.read_text(encoding="utf-8")
    text = re.sub(r"seed: \d+", f"seed: {seed}", text)
    if victims is not None:
        text = re.sub(r"victims: \d+", f"victims: {victims}", text).replace(NORTH, HALF_WAY)
    for index, port in enumerate(links):
        text = text.replace(f"udpin:127.0.0.1:{14551 + index}", f"udpin:127.0.0.1:{port}")
    path = folder / MISSION.name
    path.write_text(text, encoding="utf-8")
    (folder / "search_and_rescue").symlink_to(MISSION.with_suffix(""))
    return path


class Troubles:
    """Kills daemons and cuts links of a run."""

    def __init__(self, course: Course, relays: list[Relay]) -> None:
        self._course, self._relays = course, relays
        self._dice = random.Random(f"troubles {course.number}")
        self._pids: dict[str, int] = {}
        self._began = time.monotonic()

    def heard(self, line: str) -> None:
        """Take a line that the run has written."""
        if found := _STARTED.search(line):
            self._pids[found["name"]] = int(found["pid"])
        elif (found := _ARRIVES.search(line)) and self._dice.random() < AIMED_SHARE:
            board = f"pi{int(found['number']) + 1}"
            daemon = self._dice.choice(("agentd", "agentd", "bridged", "commd"))
            name = next(name for name in sorted(self._pids) if name.startswith(f"{daemon} {board}"))
            asyncio.get_running_loop().call_later(self._dice.uniform(0, AIM), self._kill, name, "aimed")

    async def go_on(self) -> None:
        """Trouble the run until cancelled, several troubles at a time."""
        async with asyncio.TaskGroup() as lasting:
            while True:
                await asyncio.sleep(self._dice.uniform(*PAUSE))
                match self._dice.choices(list(SHARES), list(SHARES.values()))[0]:
                    case "cut":
                        lasting.create_task(self._cut())
                    case "freeze":
                        lasting.create_task(self._freeze(self._dice.choice(sorted(self._pids))))
                    case _:
                        self._kill(self._dice.choice(sorted(self._pids)), "random")

    def _kill(self, name: str, how: str) -> None:
        with suppress(ProcessLookupError):
            os.kill(self._pids[name], signal.SIGKILL)
            self._note("aimed kills" if how == "aimed" else "kills", f"kill {name} ({how})")

    async def _cut(self) -> None:
        links = self._dice.choice([self._relays[:1], self._relays[1:2], self._relays[2:], self._relays[:2]])
        seconds = self._dice.uniform(*CUT)
        self._note("cuts", f"cut {len(links)} link(s) for {seconds:.0f} s")
        for link in links:
            link.cut()
        try:
            await asyncio.sleep(seconds)
        finally:
            for link in links:
                link.mend()

    async def _freeze(self, name: str) -> None:
        pid, seconds = self._pids[name], self._dice.uniform(*FREEZE)
        self._note("freezes", f"freeze {name} for {seconds:.0f} s")
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGSTOP)
        try:
            await asyncio.sleep(seconds)
        finally:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGCONT)

    def _note(self, kind: str, text: str) -> None:
        self._course.troubles[kind] += 1
        self._course.diary.append(f"{time.monotonic() - self._began:6.1f} {text}")


class Hearing:
    """Troubles a run from its first lane on until it says how it ends."""

    def __init__(self, course: Course, troubles: Troubles) -> None:
        self._course, self._troubles = course, troubles
        self._at_work: asyncio.Task[None] | None = None

    def line(self, line: str) -> None:
        """Take a line that the run has written."""
        self._troubles.heard(line)
        if self._at_work is None and "lane 0" in line:
            self._at_work = asyncio.create_task(self._troubles.go_on())
        if re.search(r"s  argosy: (done|failed|stopped)", line):
            self.end()
        if line.startswith("error:"):
            self._course.why = line

    def end(self) -> None:
        """Make no more troubles."""
        if self._at_work is not None:
            self._at_work.cancel()


async def fly(number: int, folder: Path, victims: int | None = None) -> Course:
    """Fly one run with its troubles, and let the referee judge it; with so many victims, or the mission's."""
    course = Course(number)
    routers, vehicles, between = neighbouring_ports(6), neighbouring_ports(3), neighbouring_ports(3)
    mission = write_mission(folder, number, vehicles, victims)
    first, second = routers[3:5]  # where pi1 and pi2 listen for others, by `argosy.processes.process_table.places`
    pairs = list(zip((first, first, second), between, strict=True))
    wiring = ",".join(f"tcp/127.0.0.1:{target}=tcp/127.0.0.1:{relay}" for target, relay in pairs)
    report = folder / "report"
    command = ["run", str(mission), "--plain", "--report", str(report), "--router", f"tcp/127.0.0.1:{routers[0]}"]
    began = time.monotonic()
    async with AsyncExitStack() as stack:
        relays = [await stack.enter_async_context(Relay(relay, target)) for target, relay in pairs]
        relayed = ("tests.support.relayed_run", wiring, *command)
        hearing = Hearing(course, Troubles(course, relays))
        try:
            course.code = await watched(relayed, folder / "run.log", hearing.line, PATIENCE)
        finally:
            hearing.end()
        if course.code is None:
            course.why = f"not done after {PATIENCE:.0f} s"
    course.seconds = time.monotonic() - began
    try:
        course.verdict = judge_run(load_mission(mission), report)
    except (OSError, ValueError) as error:
        course.why = str(error)
    (folder / "troubles.txt").write_text("\n".join(course.diary) + "\n", encoding="utf-8")
    return course


def told(course: Course) -> str:
    """Return one line about a run."""
    happened = ", ".join(f"{count} {what}" for what, count in sorted(course.troubles.items())) or "no troubles"
    ended = "done" if course.code == 0 else f"exit {course.code}: {course.why}"
    return f"run {course.number}: {course.judged}; {ended} in {course.seconds:.0f} s; {happened}"


def main() -> int:
    """Fly the runs and write the report. Returns the exit code: 0 only if all were good."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=RUNS)
    parser.add_argument("--first", type=int, default=1, help="number of the first run, which is its seed")
    parser.add_argument("--keep", type=Path, help="keep logs of the runs there")
    parser.add_argument("--no-report", action="store_true", help="do not write docs/measurements/soak.md")
    args = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # so that a run ends with its test
    courses = []
    for number in range(args.first, args.first + args.runs):
        with tempfile.TemporaryDirectory() as temporary:
            folder = args.keep / str(number) if args.keep is not None else Path(temporary)
            folder.mkdir(parents=True, exist_ok=True)
            courses.append(asyncio.run(fly(number, folder)))
        print(told(courses[-1]), flush=True)
    good = sum(course.good for course in courses)
    if not args.no_report:
        write_section("Search and rescue", report(courses))
    return 0 if good == len(courses) else 1


def report(courses: list[Course]) -> list[str]:
    """Return the section of the report."""
    good = sum(course.good for course in courses)
    troubles = sum((course.troubles for course in courses), Counter[str]())
    kills, aimed, cuts = troubles["kills"] + troubles["aimed kills"], troubles["aimed kills"], troubles["cuts"]
    freezes = f"{troubles['freezes']} daemons stopped for {FREEZE[0]:g} to {FREEZE[1]:g} s"
    return [
        f"`missions/search_and_rescue.yaml`, the daemons of three boards on one machine, {len(courses)} seeded runs "
        f"with {kills} daemons killed (-9), {aimed} of them just when a rescuer was to drop its buoy, {freezes}, and "
        f"{cuts} cuts of links between boards, of {CUT[0]:g} to {CUT[1]:g} s: **in {good} of {len(courses)} the "
        "mission was done and each victim had exactly one buoy, within 5 m**.",
        "",
        *table("run | wall s | kills | aimed at a drop | freezes | cuts | referee | end", map(_row, courses)),
    ]


def _row(course: Course) -> tuple[object, ...]:
    happened = (course.troubles[what] for what in ("kills", "aimed kills", "freezes", "cuts"))
    return course.number, f"{course.seconds:.0f}", *happened, course.judged, "done" if course.code == 0 else course.why


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
