"""How long the daemons take from the start of their process until they serve, and an agent until its first plan.

Each is started several times in each of three states of the machine, the first agent's start also stretch by stretch.
Beside them, in the same run, a bare Python process that opens a Zenoh session: what a daemon takes is told in times of
that. A router runs all the time, but for `commd` and `argosy board`, which bring their own.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from benchmarks.parts import Goal, tell
from benchmarks.plots import COLOURS, figure, svg
from benchmarks.processes import BenchmarkFailed
from benchmarks.results import Origin
from benchmarks.serving import FIRST, KINDS, NAMES, Site, kind, serving
from benchmarks.startup import cold
from benchmarks.startup.cold import Cache, copied, dropped, environment
from benchmarks.startup.phases import PREFIX
from benchmarks.watched import Watched, watched_command

REPEATS: Final = 5
WARM, CACHE, COMPILED = "warm", "page cache dropped", "first start"
STATES: Final = {
    WARM: "byte code and libraries are in the page cache",
    CACHE: "the files of Python, libraries and Argosy were dropped from the page cache, as far as the kernel lets go "
    "of them; no boot: folders are still known, and a router and what measures run",
    COMPILED: "Argosy has no byte code, as in a clone's first start where Python keeps none; libraries have theirs",
}
STRETCHES: Final = {
    "interpreter": "the interpreter itself",
    "imports": "imports",
    "mission": "reading the mission",
    "program": "reading and compiling the program",
    "session": "opening the session",
    "greeting": "finding commd",
    "joining": "claiming the name, opening the checkpoint",
    "roster": "asking who is there",
    "plan": "the first plan",
}
"""What `benchmarks.startup.phases` tells, in their order; the last one ends with what the plan prints."""


@dataclass
class Start:
    """The starts of one kind of process."""

    name: str
    state: str
    seconds: list[float] = field(default_factory=list)

    @property
    def median(self) -> float:
        return statistics.median(self.seconds)


@dataclass
class Figures:
    """What was measured."""

    starts: list[Start] = field(default_factory=list)
    stretches: dict[str, dict[str, float]] = field(default_factory=dict)
    """Of each state, the seconds of each stretch of an agent's start, medians."""
    left: float = 0.0
    size: float = 0.0
    """MB of the files that were still in memory after they had been dropped, at worst, and MB of all of them."""

    def of(self, name: str, state: str) -> Start:
        """Return the starts of a kind. Raises StopIteration."""
        return next(one for one in self.starts if (one.name, one.state) == (name, state))

    def ratio(self, name: str, state: str) -> float:
        """Return how often a bare process with a session would have been started in the time."""
        return self.of(name, state).median / self.of("bare", state).median


def measure(quick: bool) -> Figures:
    """Start everything in each state, in turns. Raises BenchmarkFailed."""
    return measured(tuple(STATES), 1 if quick else REPEATS)


def measured(states: Sequence[str], repeats: int) -> Figures:
    """Start everything so often in some states. Raises BenchmarkFailed."""
    figures = Figures()
    with tempfile.TemporaryDirectory() as folder:
        compiled = copied(Path(folder) / "compiled", compiled=True)
        plain = copied(Path(folder) / "plain", compiled=False) if COMPILED in states else compiled
        paths = cold.files(compiled) if CACHE in states else []
        for state in states:
            _measure_state(figures, state, plain if state == COMPILED else compiled, paths, repeats)
            tell(f"{state}: {figures.of('agentd', state).median:.2f} s until the first plan")
    return figures


def _measure_state(figures: Figures, state: str, code: Path, paths: list[Path], repeats: int) -> None:
    runs: list[dict[str, float]] = []
    starts = {one.name: Start(one.name, state) for one in KINDS}

    def prepare() -> None:
        if state == CACHE:
            _note(figures, dropped(paths))

    for _ in range(repeats):
        with ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            site = Site.made(folder / "site", code)
            for name in ("board", "commd"):
                prepare()
                with _started(site, name, code) as (_, seconds):
                    starts[name].seconds.append(seconds)
            stack.enter_context(serving(site, "commd"))
            for name in ("bare", "bridged", "client", "agentd"):
                prepare()
                with _started(site, name, code) as (_, seconds):
                    starts[name].seconds.append(seconds)
            prepare()
            runs.append(_stretches(site, code))
    figures.starts += starts.values()
    figures.stretches[state] = {one: statistics.median(run[one] for run in runs) for one in STRETCHES}


def _note(figures: Figures, cache: Cache) -> None:
    figures.left, figures.size = max(figures.left, cache.left), cache.size


class _started:
    """A process while the block lasts, and the seconds from its start until it served."""

    def __init__(self, site: Site, name: str, code: Path) -> None:
        self._kind = kind(name)
        self._stack = ExitStack()
        self._command = [*environment(code), *site.command(name)]

    def __enter__(self) -> tuple[Watched, float]:
        begun = time.monotonic()
        process = self._stack.enter_context(watched_command(self._kind.name, self._command))
        try:
            return process, said(process, self._kind.says) - begun
        except BaseException:
            self._stack.close()
            raise

    def __exit__(self, *_: object) -> None:
        self._stack.close()


def said(process: Watched, words: str) -> float:
    """Wait until a process has said something. Returns when it came. Raises BenchmarkFailed."""
    process.says(words)
    return next(at for at, line in process.said if words in line)


def _stretches(site: Site, code: Path) -> dict[str, float]:
    """Start an agent that tells how far it is. Returns the seconds of each stretch."""
    script = str(Path(__file__).with_name("phases.py"))
    command = [*environment(code), *site.command("agentd")]
    at = command.index("-m")
    begun = time.monotonic()
    with watched_command("agentd", [*command[:at], script, *command[at + 2 :]]) as process:
        printed = said(process, FIRST)
        process.says(f"{PREFIX} roster")
        marks = [line.split()[1:] for _, line in process.said if line.startswith(PREFIX)]
    found, before = dict.fromkeys(STRETCHES, 0.0), begun
    for name, moment in [*marks, ("plan", str(printed))]:
        if name not in found:
            raise BenchmarkFailed(f"no stretch of the start is called {name}")
        found[name] += float(moment) - before
        before = float(moment)
    return found


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the tables."""
    lines = [
        origin.line(),
        "",
        f"Seconds from the start of the process, medians of {len(figures.starts[0].seconds)} starts; in brackets, how "
        "many starts of a bare Python process with a Zenoh session that is.",
        "",
        f"| until | {' | '.join(STATES)} |",
        "|---|" + "---|" * len(STATES),
    ]
    for one in KINDS:
        until = "its first plan" if one.says == FIRST else "it serves" if one.name != "bare" else "it is open"
        lines.append(f"| {NAMES[one.name]}: {until} | {' | '.join(_cell(figures, one.name, s) for s in STATES)} |")
    lines += ["", *(f"- *{state}*: {text}." for state, text in STATES.items())]
    lines[-2] += (
        f" Of {figures.size:.0f} MB of files, up to {figures.left:.0f} MB stayed, for other processes use them."
    )
    lines += [
        "",
        "Where an agent's start goes, in milliseconds:",
        "",
        f"| stretch | {' | '.join(STATES)} |",
        "|---|" + "---|" * len(STATES),
    ]
    for name, text in STRETCHES.items():
        cells = " | ".join(f"{1000 * figures.stretches[state][name]:.0f}" for state in STATES)
        lines.append(f"| {text} | {cells} |")
    lines += ["", "![Where an agent's start goes](figures/startup.svg)"]
    return {"startup": "\n".join(lines)}


def _cell(figures: Figures, name: str, state: str) -> str:
    seconds = f"{figures.of(name, state).median:.2f} s"
    return seconds if name == "bare" else f"{seconds} ({figures.ratio(name, state):.1f})"


def pictures(figures: Figures) -> dict[str, str]:
    """Draw the stretches of an agent's start."""
    with figure(height=2.4) as (made, axes):
        for row, state in enumerate(reversed(STATES)):
            left = 0.0
            for place, name in enumerate(STRETCHES):
                width = 1000 * figures.stretches[state][name]
                shade = 0.25 + 0.75 * (place % 2)
                axes.barh(row, width, left=left, color=COLOURS["agentd"], alpha=shade, edgecolor="white")
                if width > 60:
                    axes.text(left + width / 2, row, name, ha="center", va="center", fontsize=7)
                left += width
        axes.set_yticks(range(len(STATES)), list(reversed(STATES)))
        axes.set_xlabel("ms from the start of agentd to the agent's first plan")
        return {"startup": svg(made)}


def goals(figures: Figures) -> list[Goal]:
    """Nothing is asked of the seconds: `tests/test_imports.py` keeps what is imported."""
    return []
