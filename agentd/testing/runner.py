"""Run one test plan: a fresh mind in a team of its own, on virtual time, until its goal has ended."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from agentd.language.syntax_tree.signatures import signature
from agentd.language.syntax_tree.source import read_source
from agentd.language.terms.terms import Literal
from agentd.mind import Mind
from agentd.mind.data.effects import Log, Print, StopTeam
from agentd.mind.data.inputs import GoalAdded
from agentd.standalone.standalone_team import Team, VirtualClock
from agentd.testing.assertions import FAILED
from agentd.testing.discovery import LIBRARY, Case, TestPaths
from agentd.testing.results import Asserted, Outcome, TestEnded, Verdict
from schemas.wire.mind_records import DecisionView

if TYPE_CHECKING:
    from agentd.environment import Environment

_RUN = signature("agentd_run_test")
MOST_SETTLING = 1000
"""Turns of the team that initial beliefs and goals get before the test begins, and other intentions after it at each
moment, of which there are as many at most."""

RUNS_ON = 10.0
"""Seconds of its own time that a test goes on after its goal, for assertions in intentions of their own."""

_PATIENCE = 1.0
"""Real seconds between looks at the clock while an action is settled by another thread of the environment."""

RING_AGAIN = 0.5
"""Real seconds after which a test that has used up its time is ended again: the user's code may have swallowed it."""

MOST_RINGS = 6
"""Interrupts of a test; code that still goes on is ended with the process."""

DECISIONS = 200
"""The last decisions of each agent; of a failed test those in which no plan applied are reported."""

MOST_LINES = 1000
"""Lines of a test's output that are kept."""


@dataclass(frozen=True, slots=True)
class Settings:
    """How tests are run; each is bounded in seconds of its own time, and in real ones."""

    paths: TestPaths
    own_seconds: float = 3600.0
    real_seconds: float = 30.0
    seed: int = 0
    environment: Callable[[], Environment | None] = field(default=lambda: None)
    environment_arguments: tuple[str, ...] = ()


class _OutOfTime(BaseException):
    """A test has used up its real time; no plan or internal action may catch this."""


def run_case(case: Case, settings: Settings) -> Outcome:
    """Run one test plan."""
    position = case.plan.position
    outcome = Outcome(case.name, position.file, position.line, own_assertions=case.own_assertions)
    begun = time.monotonic()
    late = f"not done after {settings.real_seconds:g} s of real time"
    team: _TestTeam | None = None
    try:
        with _alarm(settings.real_seconds):
            team = _TestTeam(case, settings, outcome)
            team.run_test(settings.own_seconds)
    except _OutOfTime:
        if team is None:
            outcome.verdict, outcome.message = Verdict.TIMED_OUT, f"the environment's init was {late}"
        else:
            team.give_up(late)
    finally:
        if team is not None:
            _close(team, settings.real_seconds, outcome)
    if team is not None and not outcome.passed:
        outcome.unapplied = [line for mind in team.minds.values() for line in _unapplied(mind)]
    outcome.seconds = time.monotonic() - begun
    outcome.excerpt = _line_at(outcome.place)
    return outcome


def _unapplied(mind: Mind) -> Iterator[str]:
    """Report the events for which none of an agent's plans applied, each plan with the reason."""
    for decision in mind.decision_views():
        if isinstance(decision, DecisionView) and decision.chosen is None and decision.rejected:
            by_us = decision.asked_at.startswith(str(LIBRARY)) or not decision.asked_at
            yield f"no plan applied to {decision.event}" + ("" if by_us else f", raised at {decision.asked_at}")
            for one in decision.rejected:
                yield f"    {one.plan.label or one.plan.trigger} ({one.plan.position}): {one.message}"


def _close(team: _TestTeam, seconds: float, outcome: Outcome) -> None:
    """Stop the environment, with the same time limit as the test."""
    try:
        with _alarm(seconds):
            team.close()
    except _OutOfTime:
        why = f"the environment's stop was not done after {seconds:g} s of real time"
        if outcome.passed:
            outcome.verdict, outcome.message = Verdict.TIMED_OUT, why
        else:
            outcome.message += f"; and then {why}"


class _TestTeam(Team):
    """The agent that runs the test, and those it creates; their output is kept, not shown."""

    def __init__(self, case: Case, settings: Settings, outcome: Outcome) -> None:
        self._outcome = outcome
        self._ended: TestEnded | None = None
        self._first_failure: Asserted | None = None
        self._stopped = 0
        name = Path(case.file).stem
        super().__init__(
            [(name, case.program)],
            settings.seed,
            paths=settings.paths,
            clock=VirtualClock(),
            environment=settings.environment(),
            environment_arguments=settings.environment_arguments,
            decisions=DECISIONS,
        )
        self._mind = self.minds[name]

    def run_test(self, seconds: float) -> None:
        """Run until the agent is idle, pursue the goal of the test for at most `seconds` of its own time, and judge."""
        self._settle()
        self._mind.feed(GoalAdded(Literal(_RUN)))
        late = self.clock.now() + seconds
        while self._ended is None:
            if self.turns():
                continue
            if self.idle:
                self._at_rest()
                return
            now = self.clock.now()
            wake = min(self.due(None), default=None)
            if wake is None:
                assert self._world is not None  # a team that is not idle with nothing due waits for its environment
                self._world.sleep(_PATIENCE)
                continue
            if wake > late:
                self.give_up(f"not done after {seconds:g} s of its own time")
                return
            self.pass_time(wake - now)
        self._run_on(self.clock.now() + RUNS_ON)
        self._judge(self._ended)

    def _run_on(self, end: float) -> None:
        """Let the other intentions of the test go on, until none is due before the end."""
        for _ in range(MOST_SETTLING):
            self._settle()
            wake = min(self.due(None), default=end)
            if wake >= end:
                return
            self.pass_time(wake - self.clock.now())

    def _settle(self) -> None:
        for _ in range(MOST_SETTLING):
            if not self.turns():
                return

    def _judge(self, ended: TestEnded) -> None:
        outcome, failure = self._outcome, self._first_failure
        if failure is not None:
            outcome.verdict, outcome.message = Verdict.FAILED, failure.message
            outcome.formula, outcome.goals = failure.formula, failure.goals
            outcome.place = f"{failure.file}:{failure.line}" if failure.line else ""
        elif ended.error:
            outcome.verdict = Verdict.FAILED if ended.error == FAILED else Verdict.ERROR
            outcome.message = f"{ended.error}: {ended.message}" if ended.message else ended.error
            outcome.formula = ended.formula
            if ended.file == str(LIBRARY):
                outcome.message, outcome.formula = f"{ended.error}: the context of the test plan does not hold", ""
            else:
                outcome.place = f"{ended.file}:{ended.line}" if ended.line else ""
        elif self._stopped:
            outcome.verdict, outcome.message = Verdict.ERROR, f".stopMAS ended the team with exit code {self._stopped}"

    def _at_rest(self) -> None:
        """Nothing can happen any more, and the goal of the test has not ended."""
        if any(frame for intention in self._mind.all_intentions() for frame in intention.stack):
            self.give_up("it waits for something that can no longer happen")
            return
        self._judge(TestEnded("dropped", "the intention of the test was dropped before it ended"))

    def give_up(self, why: str) -> None:
        """End a test that is not done, and will not be."""
        outcome = self._outcome
        if self._first_failure is not None:
            self._judge(TestEnded())
            outcome.message += f"; and then {why}"
            return
        outcome.verdict, outcome.message = Verdict.TIMED_OUT, why
        for intention in self._mind.all_intentions():
            tested = any(frame[2].sig is _RUN for frame in intention.stack)
            if tested and intention.last is not None:
                position = intention.last.syntax.position
                outcome.place = f"{position.file}:{position.line}"

    def close(self) -> None:
        """Stop the environment."""
        if self._world is not None:
            self._world.stop()

    def _write_line(self, line: str) -> None:
        if len(self._outcome.output) < MOST_LINES:
            self._outcome.output.append(line)

    def _carry_out(self, mind: Mind, effect: Any) -> None:
        match effect:
            case Asserted():
                self._outcome.assertions += 1
                if effect.message and self._first_failure is None:
                    self._first_failure = effect
            case TestEnded():
                self._ended = self._ended or effect
            case Print(text=text):
                self._write_line(f"[{mind.name}] {text}")
            case Log(level=level, text=text):
                if level != "debug":
                    self._write_line(f"[{mind.name}] {level}: {text}")
            case StopTeam(exit_code=code):
                self._stopped = self._stopped or code
            case _:
                super()._carry_out(mind, effect)


@contextmanager
def _alarm(seconds: float) -> Iterator[None]:
    """End what takes more real seconds than this with `_OutOfTime`, also in the middle of a computation.

    It is ended again while it goes on; when that has not helped either, the process ends, with exit code 2.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread can be interrupted; the bound on the test's own time remains
        return

    rings: int | None = 0

    def ring(number: int, frame: FrameType | None) -> None:
        nonlocal rings
        if rings is None:
            return
        rings += 1
        if rings > MOST_RINGS:
            _end_process(frame)
        raise _OutOfTime

    before = signal.signal(signal.SIGALRM, ring)
    begun = time.monotonic()
    others, interval = signal.setitimer(signal.ITIMER_REAL, seconds, RING_AGAIN)
    try:
        try:
            yield
        finally:
            rings = None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
        if others:  # an alarm of those who run the tests in their own process
            signal.setitimer(signal.ITIMER_REAL, max(0.001, others - (time.monotonic() - begun)), interval)


def _end_process(frame: FrameType | None) -> None:
    place = "" if frame is None else f" ({frame.f_code.co_filename}:{frame.f_lineno})"
    print(f"agentd test: error: code{place} ignores the end of its time; the process ends", file=sys.stderr)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(2)


def _line_at(place: str) -> str:
    """Return the line of source at ``file:line``, stripped; empty where there is none."""
    file, _, line = place.rpartition(":")
    if not file or not line.isdigit():
        return ""
    try:
        return read_source(file).line(int(line)).strip()
    except (OSError, UnicodeDecodeError):
        return ""
