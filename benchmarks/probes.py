"""Costs of one revision: reasoner, loop, footprint, bridge and mail, each as figures of which less is better.

python -m benchmarks.probes NAME [--quick]     in the folder of that revision; prints `FOUND {...}`

The file is copied into the tree of the earlier revision and drives the benchmarks of that tree, so it uses only names
that both revisions have, in modules that may have moved since. Processor time is preferred to elapsed time: other load
on the machine disturbs it less.
"""

from __future__ import annotations

import re
import resource
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import msgspec

from benchmarks.loop import flood, latency
from benchmarks.loop.board import board
from benchmarks.mail import agents, boards
from benchmarks.mail import part as mail_part
from benchmarks.mail.part import BATCH, FLYING
from benchmarks.processes import BenchmarkFailed, lines, started
from benchmarks.reasoner.footprint import FOOTPRINTS, program_of_plans
from benchmarks.reasoner.instructions import counted
from benchmarks.reasoner.rows import PROGRAMS, ROWS
from benchmarks.reasoner.subjects import Agentd
from benchmarks.results import ROOT


def _first_of(*names: str) -> Any:
    """Import the first of some modules that the tree has."""
    for name in names:
        with suppress(ModuleNotFoundError):
            return import_module(name)
    raise ModuleNotFoundError(f"none of {', '.join(names)}")


bridge_part = _first_of("benchmarks.bridge.part", "benchmarks.bridge")
footprints = _first_of("benchmarks.startup.footprints", "benchmarks.footprint")
Watched = _first_of("benchmarks.watched", "benchmarks.processes").Watched

Found = dict[str, float]
"""By title, with the unit in brackets."""

_ROUND: Final = re.compile(r"BENCH (\S+) round +\d+ +ops +(\d+) +ns +(\d+)")
_BY_PROCESSOR_TIME: Final = """
import runpy, sys, time
time.monotonic, time.perf_counter_ns = time.process_time, time.process_time_ns
module, sys.argv = sys.argv[1], sys.argv[1:]
runpy.run_module(module, run_name="__main__", alter_sys=True)
"""
"""Runs a module whose clocks show the processor time of its process."""
COUNTED: Final = ("f", "f2", "h")
TURNS: Final = 300
PAUSE: Final = 0.008
"""Seconds between two turns of the loop."""
PERCEPTS: Final = 500.0
"""Hz."""
LETTERS, MESSAGES, TALKS, QUEUED = 200, 24_000, 3_000, 50_000


def reasoner(quick: bool) -> Found:
    """Processor time per operation of each row, instructions per cycle, start and memory."""
    found: Found = {}
    for programs, environment in dict.fromkeys((row.agents, row.environment) for row in ROWS):
        rows = [row for row in ROWS if (row.agents, row.environment) == (programs, environment)]
        if quick and rows[0].key != "g":
            continue
        spent = _rounds(rows[0].paths(), environment)
        found |= {f"{row.operation} (ns)": min(spent[row.bench]) for row in rows}
    for row in ROWS:
        if row.key in COUNTED and not quick:
            found[f"{row.operation}, a cycle (instructions)"] = counted(row).whole
    for one in FOOTPRINTS:
        if one.unit == "MB":
            found[f"{one.title} ({one.unit})"] = one.measure(Agentd(), 1 if quick else 3)
    with tempfile.TemporaryDirectory() as folder:
        plans = Path(folder, "plans.asl")
        plans.write_text(program_of_plans(1000), encoding="utf-8")
        for title, program in (("start", PROGRAMS / "s_first.asl"), ("start of a program of 1,000 plans", plans)):
            found[f"{title}, processor time (s)"] = min(_start(program) for _ in range(1 if quick else 5))
    return found


def _start(program: Path) -> float:
    """Return the processor time of a program in seconds from its start to its end, after its first print."""
    before = _processor_of_children()
    with Agentd().prepared([("ag", program)]) as command, started(command) as process:
        for _ in lines(process):
            pass
        process.wait()
    return _processor_of_children() - before


def _rounds(programs: list[tuple[str, Path]], environment: str) -> dict[str, list[float]]:
    """Run programs. Returns ns of processor time per operation of each round, by the name of the benchmark."""
    found: dict[str, list[float]] = {}
    with Agentd().prepared(programs, environment) as command:
        by_processor_time = [command[0], "-c", _BY_PROCESSOR_TIME, *command[2:]]
        with started(by_processor_time) as process:
            for line in lines(process):
                if match := _ROUND.search(line):
                    found.setdefault(match[1], []).append(int(match[3]) / int(match[2]))
    return found


def loop(quick: bool) -> Found:
    """From the robot's sample to the next action of the plan at the robot, and percepts at a steady rate."""
    found: Found = {}
    for title, kept in (("agent kept on disk", True), ("agent not kept", False)):
        with board(kept=kept) as ours:
            count, warm_up = (10, 5) if quick else (TURNS, 50)
            spent = []
            for number in range(1, warm_up + count + 1):
                if number == warm_up + 1:
                    used = {one.name: one.cpu() for one in (ours.bridge, ours.agent)}
                begun, _, seen = latency._loop(ours, number)
                spent.append((seen - begun) / 1000)
                time.sleep(PAUSE)
            found[f"sample to next action, {title}, p50 (µs)"] = statistics.median(spent[warm_up:])
            for one in (ours.bridge, ours.agent):
                by_turn = 1e6 * (one.cpu() - used[one.name]) / count
                found[f"a turn, {title}, processor time of {one.name} (µs)"] = by_turn
    for source, title in (("tick", "replaced"), ("mark", "added")):
        (run,) = flood.measure([100.0 if quick else PERCEPTS], source, 0.5 if quick else 6.0)
        if not run.complete:
            raise BenchmarkFailed(f"of {run.changes} percepts {run.heard} came")
        for name in ("agentd", "bridged"):
            found[f"percept {title}, processor time of {name} (µs)"] = 1e4 * run.cpu[name] / run.made
    return found


def footprint(quick: bool) -> Found:
    """Resident memory of each daemon at rest."""
    figures = footprints.Figures()
    with tempfile.TemporaryDirectory() as folder:
        for names in (footprints.TOGETHER, footprints.ALONE):
            footprints.look(figures, names, Path(folder) / names[0], ROOT, 1.0 if quick else footprints.SETTLED)
    return {f"{name} (MB)": statistics.median(one.rss) for name, one in figures.held.items() if name != "bare"}


def bridge(quick: bool) -> Found:
    """Three vehicles on one link in one bridge."""
    bridge_part.SECONDS = 15.0
    figures = bridge_part.measure(quick)
    return {
        "processor time a message (µs)": 1e4 * figures.cpu / figures.messages,
        "memory (MB)": figures.rss,
        "byte in to belief event, p50 (ms)": figures.latency.p50,
    }


def mail(quick: bool) -> Found:
    """Mail from board to board, between agents, and the memory of commd."""
    letters, messages, talks, queued = (20, 480, 100, 2_400) if quick else (LETTERS, MESSAGES, TALKS, QUEUED)
    found = mail_part.in_folder(lambda folder: _between_boards(folder, letters, messages))
    before = _processor_of_children()
    rate = mail_part.in_folder(lambda folder: agents.talk(folder, talks)).rate
    used = _processor_of_children() - before
    held = mail_part.in_folder(lambda folder: mail_part.resident(folder, queued))
    return found | {
        "message between agents (µs)": 1e6 / rate,
        "message between agents, processor time of all daemons (µs)": 1e6 * used / (6 * talks),
        "commd, empty (MB)": held.empty,
        f"commd, {queued:,} queued messages (MB)": held.queued,
    }


async def _between_boards(folder: Path, letters: int, messages: int) -> Found:
    with boards.boards(folder, {"ann": "b1", "bob": "b2"}, "full") as made:
        ends = made.endpoints
        async with boards.member(ends["b1"], "ann") as ann, boards.member(ends["b2"], "bob") as bob:
            bob.open()
            await mail_part._letters(ann, bob, 10)
            alone = await mail_part._letters(ann, bob, letters)
            before, begun = sum(one.cpu() for one in made.daemons.values()), bob.came["ann"]

            def under_way(posted: int) -> bool:
                return posted - (bob.came["ann"] - begun) <= FLYING

            for posted in range(BATCH, messages + 1, BATCH):
                await ann.post(["bob"] * BATCH)
                await boards.until(partial(under_way, posted), "mail flows", 60)
            whole = begun + messages // BATCH * BATCH
            await boards.until(lambda: bob.came["ann"] == whole, "all have arrived", 60)
            used = sum(one.cpu() for one in made.daemons.values()) - before
    return {
        "message between boards, p50 (ms)": alone.p50,
        "many messages between boards, processor time of commd for one (µs)": 1e6 * used / messages,
    }


def _processor_of_children() -> float:
    """Return the processor time in seconds of all processes of this one that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


PROBES: Final[dict[str, Callable[[bool], Found]]] = {
    one.__name__: one for one in (reasoner, loop, footprint, bridge, mail)
}


def _exact_cpu(one: Any) -> float:
    """Return the processor time of a process in seconds, by its clock (`clock_getcpuclockid`) and not in ticks."""
    return time.clock_gettime(~one.process.pid << 3 | 2)


def main() -> None:
    """Run one probe."""
    Watched.cpu = _exact_cpu
    found = PROBES[sys.argv[1]]("--quick" in sys.argv)
    print("FOUND", msgspec.json.encode(found).decode(), flush=True)


if __name__ == "__main__":
    main()
