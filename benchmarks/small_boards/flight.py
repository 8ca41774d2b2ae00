"""One flight of the paper's first mission with its board in a cage."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Final

from argosy.processes.process_table import plan
from benchmarks.flights import READY, SINGLE, Flight, setup_in, with_one_process
from benchmarks.held import alone
from benchmarks.parts import tell
from benchmarks.processes import BenchmarkFailed
from benchmarks.scale.health import Records, listening
from benchmarks.small_boards.cages import caged
from benchmarks.small_boards.figures import ONE, THREE, Flown, Wanted
from benchmarks.small_boards.limits import Cage, Limits
from benchmarks.watched import Watched, watched_command

SPEED: Final = 1.0
START: Final = 150.0
"""Wall seconds that a board may take until all its daemons are there."""
FLIGHT: Final = 150.0
"""Simulated seconds that the mission may take then: more than one and a half times what it takes."""
LOOK_EVERY: Final = 4.0
SETTLED: Final = 3.0
"""Wall seconds after which a daemon tells no more of how late its loop was in its start."""


def stood(form: str) -> Flown:
    """Start a board without limits, and see what it holds on the ground."""
    with caged(Limits()) as cage, ExitStack() as stack:
        tell(f"{form}, on the ground")
        flight = _started(stack, form, cage, SPEED)
        time.sleep(SETTLED)
        elsewhere = _elsewhere(_ours(flight), cage)
        return Flown("", form, None, None, 1, cage.kind, charged=cage.usage().peak, elsewhere=elsewhere)


def fly(wanted: Wanted) -> Flown:
    """Fly the mission once."""
    limits = wanted.limits
    with caged(limits) as cage, ExitStack() as stack:
        flown = Flown(wanted.board, wanted.form, limits.memory, limits.share, limits.cores, cage.kind)
        flight = None
        try:
            flight = _started(stack, wanted.form, cage, wanted.speed)
            flown = replace(flown, ready=flight.up - flight.begun)
            return _in_flight(stack, flight, cage, flown)
        except BenchmarkFailed as failed:
            usage = cage.usage()
            why = "out of memory" if usage.killed else _why(failed, flight)
            return replace(flown, why=why, charged=usage.peak, throttled=usage.throttled)


def _started(stack: ExitStack, form: str, cage: Cage, speed: float) -> Flight:
    """Start the vehicle's simulator, then the board's daemons in the cage, and wait until they are there."""
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="argosy-bench-")))
    setup = setup_in(folder, SINGLE.mission, speed)
    planned = plan(setup) if form == THREE else with_one_process(setup, "local", plan(setup))
    flight = Flight(SINGLE, "agentspeak", setup, {})
    for process in sorted(planned, key=lambda process: process.kind.measured):
        ours = process.kind.measured
        if process.kind.name == "commd":
            flight.begun = time.monotonic()  # the board is switched on
        command = cage.command(list(process.argv)) if ours else list(process.argv)
        watched = stack.enter_context(watched_command(process.name, command))
        flight.watched.append((process, watched))
        if process.kind.name in {"commd", "simulator"}:
            _until(flight, watched, READY[process.kind.name])
    for process, watched in flight.watched:
        one_process = form == ONE and process.kind.measured
        for words in _ALL_READY if one_process else (READY[process.kind.name],):
            _until(flight, watched, words)
    flight.up = time.monotonic()
    return flight


def _why(failed: BenchmarkFailed, flight: Flight | None) -> str:
    """Return the reason of a failure: the agent's own, if it has told one."""
    watched = flight.watched if flight is not None else []
    said = [line for _, one in watched for _, line in one.said if SINGLE.given_up in line]
    if said:
        return said[0].partition(f"{SINGLE.given_up}: ")[2]
    return str(failed).partition("\n")[0].removesuffix("; last:")


_ALL_READY: Final = (READY["bridged"], READY["agentd"])


def _until(flight: Flight, watched: Watched, words: str) -> None:
    while not any(words in line for _, line in watched.said):
        for _, one in flight.watched:
            if (code := one.process.poll()) is not None:
                last = "\n".join(line for _, line in one.said[-3:])
                raise BenchmarkFailed(f"{one.name} ended with exit code {code} before all were there; last:\n{last}")
        if time.monotonic() > flight.begun + START:
            raise BenchmarkFailed(f"{watched.name} was not there after {START:g} s")
        time.sleep(0.05)


def _in_flight(stack: ExitStack, flight: Flight, cage: Cage, flown: Flown) -> Flown:
    """Wait for the end of the mission, and look at what is used meanwhile."""
    ours = _ours(flight)
    records = stack.enter_context(listening(flight.setup.router, flight.setup.mission.fleet))
    used, begun = sum(one.cpu() for one in ours), time.monotonic()
    with ThreadPoolExecutor(1) as pool:
        done = pool.submit(flight.until_done, flight.up - flight.begun + FLIGHT / flight.setup.speed)
        elsewhere: list[float] = []
        while wait([done], LOOK_EVERY).not_done:
            elsewhere.append(_elsewhere(ours, cage))
        done.result()
    ended = time.monotonic()
    usage = cage.usage()
    return replace(
        flown,
        completed=True,
        mission=flight.over - flight.up,
        charged=usage.peak,
        elsewhere=max(elsewhere, default=0.0),
        cpu=100 * (sum(one.cpu() for one in ours) - used) / (ended - begun),
        throttled=usage.throttled,
        lag=_lag(records, flight.up + SETTLED, ended),
        timed_out=sum("timed_out" in line for one in ours for _, line in one.said),
    )


def _ours(flight: Flight) -> list[Watched]:
    return [watched for process, watched in flight.watched if process.kind.measured]


def _elsewhere(ours: Sequence[Watched], cage: Cage) -> float:
    """Return the MB that processes hold and that are not charged to them: 0 where the kernel does not tell."""
    try:
        held = alone([one.process.pid for one in ours])
    except OSError:  # one has ended
        return 0.0
    return max(0.0, (held or 0.0) - cage.charged())


def _lag(records: Records, begun: float, ended: float) -> float:
    told = (one for of_one in records.of_all().values() for one in of_one)
    return max((health.lag for at, health in told if begun <= at <= ended), default=0.0)
