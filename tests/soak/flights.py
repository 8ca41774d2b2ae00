"""Fly the first mission while one daemon is killed (-9) at a random moment: does the vehicle always come home?

    python -m tests.soak.flights [--flights 20] [--first 1] [--jobs 2] [--keep FOLDER]

Each flight has a daemon and a moment of its own, by its number; all are flown with `--restart` and again without. The
verdict is the vehicle's own: a second MAVLink link of the simulated copter, which no daemon has, says whether it was
armed, and whether it stands on the ground, disarmed, when the run ends. Writes its section of
docs/measurements/soak.md.
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
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.soak.report import ROOT, table, write_section
from tests.soak.watched_run import watched
from tests.support.ports import free_port, neighbouring_ports

FLIGHTS = 20
MISSION = ROOT / "missions" / "single_uav.yaml"
DAEMONS = ("agentd", "bridged", "commd")
FLIGHT = 18.0
"""Wall seconds from the agent's start to the landing of an undisturbed flight at the mission's speed: the kill falls
within."""
PATIENCE = 300.0
"""Wall seconds of one run; the mission's own timeout is 120 s."""
BY_TIMEOUT = "not done within"
_STARTED = re.compile(r"s  (?P<daemon>commd|bridged|agentd)\b.*?: (?:re)?started, pid (?P<pid>\d+)")


@dataclass
class Vehicle:
    """What the copter says of itself on its second link."""

    heard: bool = False
    armed: bool = False
    flying: bool = False
    landed_at: float = 0.0
    """When it was disarmed last (monotonic seconds)."""

    def hears(self, message: mavlink.MAVLink_message) -> None:
        """Take a message."""
        if message.get_type() != "HEARTBEAT":
            return
        armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        if self.armed and not armed:
            self.landed_at = time.monotonic()
        self.heard, self.armed = True, armed
        self.flying = message.system_status in (mavlink.MAV_STATE_ACTIVE, mavlink.MAV_STATE_CRITICAL)

    @property
    def down(self) -> bool:
        """Whether it stands on the ground, disarmed."""
        return self.heard and not self.armed and not self.flying


class Listener(asyncio.DatagramProtocol):
    """Hears the copter's second link, and says nothing."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True

    def datagram_received(self, data: bytes, _: object) -> None:
        """Take a datagram."""
        for message in self._parser.parse_buffer(data) or ():
            self._vehicle.hears(message)


@dataclass
class Course:
    """What happened in one flight."""

    number: int
    restart: bool
    daemon: str
    moment: float
    """Wall seconds from the agent's start to the kill."""
    vehicle: Vehicle = field(default_factory=Vehicle)
    killed_at: float | None = None
    code: int | None = None
    """Exit code of `argosy run`; None: it had to be ended."""
    ending: str = ""
    """Last word of the run on how it ended."""
    seconds: float = 0.0

    @property
    def problem(self) -> str:
        """What is wrong with it; empty if the vehicle is down, and not by the mission's timeout."""
        if self.killed_at is None:
            return "nothing was killed"
        if not self.vehicle.down:
            return "the vehicle is armed or in the air"
        if self.code is None:
            return f"the run did not end within {PATIENCE:g} s"
        return "by timeout" if BY_TIMEOUT in self.ending else ""

    @property
    def home_after(self) -> float | None:
        """Wall seconds from the kill to the ground; None if it stood there already."""
        if self.killed_at is None or self.vehicle.landed_at < self.killed_at:
            return None
        return self.vehicle.landed_at - self.killed_at

    def __str__(self) -> str:
        home = "was not in the air" if self.home_after is None else f"on the ground {self.home_after:.1f} s later"
        how = "restart" if self.restart else "no restart"
        verdict = self.problem.upper() or "down"
        return f"{how} {self.number}: {self.daemon} killed after {self.moment:.1f} s, {verdict}, {home}; {self.ending}"


async def fly(course: Course, folder: Path) -> Course:
    """Fly, kill the daemon, and wait for the end of the run."""
    link, second, router = free_port(), free_port(), neighbouring_ports(2)[0]
    mission = folder / MISSION.name
    text = MISSION.read_text(encoding="utf-8").replace("udpin:127.0.0.1:14550", f"udpin:127.0.0.1:{link}")
    mission.write_text(text, encoding="utf-8")
    (folder / "single_uav").symlink_to(MISSION.with_suffix(""))
    loop = asyncio.get_running_loop()
    ears, _ = await loop.create_datagram_endpoint(lambda: Listener(course.vehicle), local_addr=("127.0.0.1", second))
    command = ["run", str(mission), "--plain", "--router", f"tcp/127.0.0.1:{router}", *["--restart"] * course.restart]
    pids: dict[str, int] = {}

    def kill() -> None:
        with suppress(ProcessLookupError):
            os.kill(pids[course.daemon], signal.SIGKILL)
            course.killed_at = time.monotonic()

    def hears(line: str) -> None:
        if started := _STARTED.search(line):
            first = started["daemon"] not in pids
            pids[started["daemon"]] = int(started["pid"])
            if first and started["daemon"] == "agentd":
                loop.call_later(course.moment, kill)
        if ended := re.search(r"s  argosy: ((?:done|failed|stopped).*)", line):
            course.ending = ended[1]

    began = time.monotonic()
    observed = ("tests.support.observed_run", f"udpout:127.0.0.1:{second}", *command)
    try:
        course.code = await watched(observed, folder / "run.log", hears, PATIENCE)
    finally:
        ears.close()
    course.seconds = time.monotonic() - began
    return course


async def fly_all(courses: list[Course], folder: Path, jobs: int) -> None:
    """Fly them, some at a time."""
    turn = asyncio.Semaphore(jobs)

    async def one(course: Course) -> None:
        place = folder / f"{'restart' if course.restart else 'plain'}-{course.number}"
        place.mkdir(parents=True)
        async with turn:
            print(await fly(course, place), flush=True)

    await asyncio.gather(*map(one, courses))


def courses_of(first: int, flights: int) -> list[Course]:
    """Return the flights by their numbers, with `--restart` and without."""
    courses = []
    for number in range(first, first + flights):
        dice = random.Random(f"flight {number}")
        daemon, moment = dice.choice(DAEMONS), dice.uniform(0.0, FLIGHT)
        courses += [Course(number, restart, daemon, moment) for restart in (True, False)]
    return courses


def report(courses: list[Course]) -> None:
    """Write the section of docs/measurements/soak.md."""
    rows = []
    for restart in (True, False):
        mine = [course for course in courses if course.restart is restart]
        good = [course for course in mine if not course.problem]
        done = sum(course.code == 0 for course in mine)
        home = sorted(course.home_after for course in mine if course.home_after is not None)
        late = f"{home[len(home) // 2]:.1f} s, {home[-1]:.1f} s at most" if home else "-"
        name = "with `--restart`" if restart else "without"
        rows.append((name, f"{len(good)} of {len(mine)}", done, len(home), late))
    kills = {daemon: sum(course.daemon == daemon for course in courses) for daemon in DAEMONS}
    lines = [
        f"`python -m tests.soak.flights --flights {len(courses) // 2}`: `missions/single_uav.yaml`, one daemon killed "
        f"(-9) at a random moment of each flight ({', '.join(f'{kills[one]} {one}' for one in DAEMONS)}). The "
        "vehicle's own second MAVLink link says whether it stands on the ground, disarmed, when the run ends; a run "
        "that ends by the mission's timeout counts as a failure.",
        "",
        *table(
            " | on the ground, disarmed, not by timeout | missions done | in the air at the kill | from kill to ground",
            rows,
        ),
    ]
    write_section("One daemon killed in flight", lines)


def main() -> int:
    """Run the soak. Returns the exit code: 1 if a vehicle was left alone."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak.flights", description=__doc__)
    parser.add_argument("--flights", type=int, default=FLIGHTS)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2, help="flights at a time (default 2)")
    parser.add_argument("--keep", type=Path, help="keep the logs here")
    args = parser.parse_args()
    courses = courses_of(args.first, args.flights)
    with tempfile.TemporaryDirectory() as folder:
        asyncio.run(fly_all(courses, args.keep or Path(folder), args.jobs))
    bad = [course for course in courses if course.problem]
    print(f"{len(courses) - len(bad)} of {len(courses)} vehicles on the ground, disarmed")
    if args.flights >= FLIGHTS and not bad:
        report(courses)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
