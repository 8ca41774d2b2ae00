"""Part `startup`: the time from the start of a daemon's process until it serves.

Each is started several times, with its byte code and without. A bare Python process that opens a Zenoh session is
started in the same run: starts are given as multiples of its start. A router runs all the time, except for `commd` and
`argosy board`, which bring their own.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from benchmarks.parts import progress, row, table
from benchmarks.processes import watched_command
from benchmarks.results import Origin
from benchmarks.serving import FIRST, NAMES, SERVES, Site, copied, environment, serving

REPEATS: Final = 5
WARM, COMPILED = "warm", "first start"
STATES: Final = {
    WARM: "byte code and libraries are in the page cache",
    COMPILED: "Argosy has no byte code, as in a clone's first start where Python keeps none; libraries have theirs",
}


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

    def of(self, name: str, state: str) -> Start:
        """Return the starts of a kind. Raises StopIteration."""
        return next(one for one in self.starts if (one.name, one.state) == (name, state))

    def ratio(self, name: str, state: str) -> float:
        """Return the start in times of the start of a bare process with a session."""
        return self.of(name, state).median / self.of("bare", state).median


def measure(quick: bool) -> Figures:
    """Start everything in each state, in turns. Raises BenchmarkFailed."""
    figures = Figures()
    for state in STATES:
        figures.starts += starts_of(state, 1 if quick else REPEATS)
        progress(f"{state}: {figures.of('agentd', state).median:.2f} s until the first plan")
    return figures


def probe(quick: bool) -> dict[str, float]:
    """Return the start of each kind of process in times of a bare one's, with byte code."""
    starts = starts_of(WARM, 1 if quick else REPEATS)
    figures = Figures(starts)
    return {f"{one.name} (bare processes)": figures.ratio(one.name, WARM) for one in starts if one.name != "bare"}


def starts_of(state: str, repeats: int) -> list[Start]:
    """Start each kind of process so often in a state. Raises BenchmarkFailed."""
    starts = {name: Start(name, state) for name in SERVES}
    with tempfile.TemporaryDirectory() as folder:
        code = copied(Path(folder) / "code", compiled=state == WARM)
        for number in range(repeats):
            site = Site.made(Path(folder) / f"site{number}", code)
            for name in ("board", "commd"):
                starts[name].seconds.append(_seconds(site, name, code))
            with serving(site, "commd"):
                for name in ("bare", "bridged", "client", "agentd"):
                    starts[name].seconds.append(_seconds(site, name, code))
    return list(starts.values())


def _seconds(site: Site, name: str, code: Path) -> float:
    """Start a process. Returns the seconds until it serves. Raises BenchmarkFailed."""
    begun, words = time.monotonic(), SERVES[name]
    with watched_command(name, [*environment(code), *site.command(name)]) as process:
        process.wait_for(words)
        return next(at for at, line in process.output if words in line) - begun


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the table."""
    lines = [
        origin.line(),
        "",
        f"Seconds from the start of the process, medians of {len(figures.starts[0].seconds)} starts; in brackets, in "
        "times of the start of a bare Python process with a Zenoh session.",
        "",
        *table(f"| until | {' | '.join(STATES)} |"),
    ]
    for name, ready in SERVES.items():
        until = "its first plan" if ready == FIRST else "it serves" if name != "bare" else "it is open"
        lines.append(row(f"{NAMES[name]}: {until}", *(_cell(figures, name, state) for state in STATES)))
    lines += ["", *(f"- *{state}*: {text}." for state, text in STATES.items())]
    return {"startup": "\n".join(lines)}


def _cell(figures: Figures, name: str, state: str) -> str:
    seconds = f"{figures.of(name, state).median:.2f} s"
    return seconds if name == "bare" else f"{seconds} ({figures.ratio(name, state):.1f})"
