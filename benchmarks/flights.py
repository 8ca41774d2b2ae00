"""Fly a mission by its own processes, with the AgentSpeak agents or with imperative programs in their place.

Minds are not queried in flight: a mission is done when its `done` formulas hold, and these are queried only after an
agent has printed that it is done. Imperative programs are done when their last lines are printed. The mission's referee
judges the result in both cases.
"""

from __future__ import annotations

import asyncio
import json
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

import yaml

from argosy.processes.process_table import Kind, Process, Setup, places, plan, python_command
from argosy.simulate.referee import judge_run
from benchmarks.processes import SPEAKS, BenchmarkFailed, Watched, watched_command
from benchmarks.serving import READY
from commd.bus.bus import Bus, open_bus
from commd.bus.errors import QueryFailed
from schemas.mission.model import Mission, load_mission
from schemas.wire import keys, term_text
from schemas.wire.mind_records import MindView
from schemas.wire.terms import Atom, Structure, Term
from tests.support.ports import free_port

MISSIONS: Final = Path(__file__).parent.parent / "missions"
LOOK_EVERY: Final = 1.0
"""Wall seconds between two looks at the minds, once the last words were printed."""
SLACK: Final = 30.0
"""Wall seconds beside the mission's own timeout: for the start."""

Approach = Literal["agentspeak", "python"]
APPROACHES: Final[tuple[Approach, ...]] = ("agentspeak", "python")


@dataclass(frozen=True)
class Course:
    """A mission that is flown, and what its agents print."""

    title: str
    mission: str
    """Its file in `missions`."""
    last_words: str
    """What an agent prints when the mission is as good as done."""
    given_up: str = ""
    """What it prints when the mission is not going to be done; empty if it never gives up."""


SINGLE: Final = Course("single UAV", "single_uav.yaml", "mission done", "mission failed")
RESCUE: Final = Course("search and rescue", "search_and_rescue.yaml", "all are rescued")

PROGRAM: Final = Kind("program", lambda setup: [], lambda setup, client: [])
"""An imperative program in the place of an agent's daemon."""
AGENTS: Final = ("agentd", PROGRAM.name)


def setup_in(folder: Path, file: str, speed: float) -> Setup:
    """Copy the missions to a folder, with links on free ports, and return how one of them is run there."""
    shutil.copytree(MISSIONS, folder / "missions", ignore=shutil.ignore_patterns("__pycache__"))
    copy = folder / "missions" / file
    copy.write_text(re.sub(r"(?<=udpin:127\.0\.0\.1:)\d+", lambda _: str(free_port()), copy.read_text()))
    return _setup(load_mission(copy), folder, speed)


def _setup(mission: Mission, folder: Path, speed: float) -> Setup:
    router = f"tcp/127.0.0.1:{free_port()}"
    (folder / "logs").mkdir(exist_ok=True)
    place = places(mission, router)
    return Setup(mission, router, speed, frozenset(), folder / "state", places=place, logs=folder / "logs")


def with_programs(setup: Setup, folder: Path) -> tuple[Setup, list[Process], dict[str, str]]:
    """Return a mission with programs instead of its agents: its setup, processes, and last line of each program."""
    file = variant(setup.mission.path, folder, speed=setup.speed)
    other = _setup(load_mission(file), folder, setup.speed)
    planned, last = plan(other), {}
    for name, agent in setup.mission.agents.items():
        module, done = PROGRAMS[Path(agent.program).stem]
        argv = (sys.executable, "-u", "-m", "benchmarks.imperative", module, str(file), name)
        settings = map(_setting, agent.beliefs)
        process = Process(
            PROGRAM, name, (*argv, other.place(agent.board).router, *settings), label=name, board=agent.board
        )
        planned.append(process)
        last[process.name] = done
    return other, planned, last


def with_one_process(setup: Setup, board: str, planned: list[Process]) -> list[Process]:
    """Return the processes with the daemons of a board in one, `argosy board`, in the place of its commd."""
    found: list[Process] = []
    for process in planned:
        if process.board != board or not process.kind.measured:
            found.append(process)
        elif process.kind.name == "commd":
            where = setup.place(board).arguments
            options = ("--speed", f"{setup.speed:g}", "--state", str(setup.state), "--simulated")
            argv = (*python_command(), "argosy", "board", setup.file, "--board", board, *where, *options)
            found.append(Process(process.kind, process.subject, argv, label=process.label, board=process.board))
    return found


@dataclass
class Flight:
    """A mission whose processes run."""

    course: Course
    approach: Approach
    setup: Setup
    last: dict[str, str]
    """The last line of each imperative program when it has nothing left to do."""
    begun: float = field(default_factory=time.monotonic)
    """Monotonic wall seconds before the first process was started."""
    watched: list[tuple[Process, Watched]] = field(default_factory=list)
    up: float = 0.0
    """When all processes were there."""
    over: float = 0.0
    """When the mission was done."""

    def until_up(self, patience: float = SPEAKS) -> None:
        """Wait until every process is there; a program has printed anything then. Raises BenchmarkFailed."""
        for process, watched in self.watched:
            watched.wait_for(READY.get(process.kind.name, ""), patience)
        self.up = time.monotonic()

    def until_done(self, patience: float | None = None) -> None:
        """Wait until the mission is done, for its own timeout or for `patience` seconds.

        Raises BenchmarkFailed for any other end, and for what the referee does not accept.
        """
        mission = self.setup.mission
        until = self.begun + (mission.timeout / self.setup.speed + SLACK if patience is None else patience)
        if self.approach == "agentspeak":
            self._until_last_words(until)
            asyncio.run(self._until_minds_say_so(until))
        else:
            self._until_last_lines(until)
        self.over = time.monotonic()
        if mission.world is not None:
            self._referee(mission)

    def _referee(self, mission: Mission) -> None:
        assert self.setup.logs is not None
        try:
            verdict = judge_run(mission, self.setup.logs)
        except (OSError, ValueError) as error:
            raise self._failed(f"the referee cannot judge: {error}") from None
        if not verdict.good:
            raise self._failed(f"the referee reports\n{verdict}\n")

    def _until_last_words(self, until: float) -> None:
        course, read = self.course, dict[str, int]()
        while True:
            for process, watched in self.watched:
                fresh = [line for _, line in watched.output[read.get(watched.name, 0) :]]
                read[watched.name] = read.get(watched.name, 0) + len(fresh)
                if not process.kind.measured:
                    continue
                if any(course.last_words in line for line in fresh):
                    return
                if course.given_up and any(course.given_up in line for line in fresh):
                    raise self._failed(f"{watched.name} gave up", watched)
            self._look_after(until)
            time.sleep(0.1)

    async def _until_minds_say_so(self, until: float) -> None:
        mission = self.setup.mission
        async with open_bus(
            self.setup.router, fleet=mission.fleet, name="bench", daemon="bench", wire=mission.wire
        ) as bus:
            while not all([await done(bus, agent) for agent in dict.fromkeys(one.agent for one in mission.done)]):
                self._look_after(until)
                await asyncio.sleep(LOOK_EVERY)

    def _until_last_lines(self, until: float) -> None:
        while True:
            left = 0
            for _, watched in self.watched:
                if (wanted := self.last.get(watched.name)) is None:
                    continue
                through = bool(watched.output) and wanted in watched.output[-1][1]
                left += not through
                if not through and (code := watched.process.poll()) is not None:
                    raise self._failed(f"{watched.name} ended with exit code {code}", watched)
            if not left:
                return
            self._look_after(until)
            time.sleep(0.1)

    def _look_after(self, until: float) -> None:
        """Raise BenchmarkFailed if a daemon or a simulator died, or the time is over."""
        for process, watched in self.watched:
            if process.kind is not PROGRAM and (code := watched.process.poll()) is not None:
                raise self._failed(f"{watched.name} ended with exit code {code}", watched)
        if time.monotonic() > until:
            raise self._failed(f"not done after {until - self.begun:.0f} s")

    def _failed(self, why: str, whose: Watched | None = None) -> BenchmarkFailed:
        shown = (
            [whose] if whose is not None else [watched for process, watched in self.watched if process.kind.measured]
        )
        last = "\n".join(f"{one.name}: {line}" for one in shown for _, line in one.output[-3:])
        return BenchmarkFailed(
            f"{self.course.title}, {self.approach}, speed {self.setup.speed:g}: {why}; last:\n{last}"
        )


@contextmanager
def flying(course: Course, approach: Approach, speed: float) -> Iterator[Flight]:
    """Start all processes of a mission and wait until they are there; they are ended with the block.

    Raises BenchmarkFailed.
    """
    with ExitStack() as stack:
        folder = Path(
            stack.enter_context(tempfile.TemporaryDirectory(prefix="argosy-bench-", ignore_cleanup_errors=True))
        )
        setup = setup_in(folder, course.mission, speed)
        planned, last = plan(setup), dict[str, str]()
        if approach == "python":
            setup, planned, last = with_programs(setup, folder)
        flight = Flight(course, approach, setup, last)
        start_all(stack, planned, flight.watched)
        flight.until_up()
        yield flight


def start_all(
    stack: ExitStack,
    planned: list[Process],
    started: list[tuple[Process, Watched]],
    command: Callable[[list[str]], list[str]] = lambda argv: argv,
    patience: float = SPEAKS,
) -> None:
    """Start processes in their order: the others when the routers are there, the agents when the bridges are.

    `command` makes of a command line the one that is started; it must end by an exec, to keep the pid. `patience` is
    in seconds, for each process. Raises BenchmarkFailed.
    """
    for process in planned:
        if process.kind.name in AGENTS:
            for before, bridge in started:
                if before.kind.name == "bridged":
                    bridge.wait_for(READY["bridged"], patience)
        watched = stack.enter_context(watched_command(process.name, command(list(process.argv))))
        started.append((process, watched))
        if process.kind.name == "commd":
            watched.wait_for(READY["commd"], patience)


ANSWER: Final = 2.0
"""Wall seconds for an answer of a mind."""


async def done(bus: Bus, agent: str) -> bool:
    """Return whether the `done` formulas of an agent hold; a look that shows next to nothing else, to cost little."""
    key = f"{keys.mind(bus.fleet, agent)}?last=0;beliefs=0;about=nothing"
    try:
        view = await bus.ask_one(key, None, MindView, ANSWER)
    except QueryFailed:
        return False
    return bool(view.done) and all(view.done.values())


PROGRAMS: Final = {
    "uav": ("single_uav", "mission done"),
    "scout": ("scout", "all are rescued"),
    "rescuer": ("rescuer", "resting"),
}
"""For each AgentSpeak program the imperative one, and its last line when its part of the mission is done.

A rescuer that rests may be called again, and prints so: the mission is done when these are the last lines of all.
"""


def variant(original: Path, folder: Path, *, speed: float) -> Path:
    """Write a mission into a folder with its agents as clients, and all else as it was; returns the file.

    A client knows the speed only from the file. Raises Findings for a bad mission.
    """
    mission = load_mission(original)
    raw: dict[str, Any] = yaml.safe_load(mission.path.read_text(encoding="utf-8"))
    raw["clients"] = {name: {"board": agent.board, "robot": agent.robot} for name, agent in mission.agents.items()}
    raw |= {"agents": {}, "speed": speed}
    for name in ("done", "failed"):  # formulas over beliefs, which no program has
        raw.pop(name, None)
    for robot in raw["robots"].values():
        if (file := mission.relative(robot["manifest"])).is_file():
            robot["manifest"] = str(file.resolve())
    file = folder / mission.path.name
    file.write_text(yaml.safe_dump(raw, sort_keys=False), encoding="utf-8")
    return file


def _setting(belief: str) -> str:
    """Return a belief as a program takes it: `height(10)` is `height=10`."""
    match term_text.read(belief):
        case Structure(functor, (value,)):
            return f"{functor}={json.dumps(_plain(value))}"
        case Structure(functor, values):
            return f"{functor}={json.dumps([_plain(value) for value in values])}"
    raise ValueError(f"{belief}: expected a fact with values")


def _plain(term: Term) -> Any:
    match term:
        case Atom(name):
            return name
        case list():
            return [_plain(one) for one in term]
    return term
