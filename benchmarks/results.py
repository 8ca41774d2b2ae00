"""Save and load the results of a part: its figures, with machine, date and versions.

`benchmarks/results/PART.json` is the source of pages and pictures (`benchmarks.pages`): no figure is typed by hand.
"""

from __future__ import annotations

import os
import platform
import resource
import subprocess
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec

T = TypeVar("T")

ROOT: Final = Path(__file__).parent.parent
RESULTS: Final = Path(__file__).parent / "results"
PACKAGES: Final = ("argosy", "eclipse-zenoh", "msgspec", "pymavlink", "psutil", "aiohttp", "agentspeak", "matplotlib")
"""Packages whose versions are recorded."""


@dataclass(frozen=True)
class Origin:
    """Where figures come from."""

    date: str
    """Of the end of the measurement: YYYY-MM-DD, UTC."""
    machine: str
    """The processor as the kernel calls it, and the kind of machine."""
    cores: int
    memory: float
    """GB of the machine."""
    system: str
    python: str
    versions: dict[str, str]
    revision: str
    """Of the code that was measured; with a `+` behind it files had been changed, before or meanwhile."""
    load: float
    """Cores that were busy in the seconds before the measurement: somebody else was at work."""
    others: float
    """Cores that others kept busy while it lasted, on average."""
    command: str

    def line(self) -> str:
        """Return it as a sentence for a page."""
        versions = ", ".join(f"{name} {number}" for name, number in self.versions.items() if name != "argosy")
        return (
            f"Measured by `{self.command}` on {self.date}: {self.cores} cores of {self.machine}, {self.memory:.0f} GB, "
            f"{self.system}, Python {self.python}, {versions}; Argosy at {self.revision}; "
            f"others kept {self.load:.1f} cores busy before the run and {self.others:.1f} during it."
        )


@dataclass(frozen=True)
class Moment:
    """How long the machine has been busy, and this process with those of its children that have ended."""

    at: float
    busy: float
    """Seconds of all cores."""
    own: float


def moment() -> Moment:
    """Return the present one."""
    own, ended = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = own.ru_utime + own.ru_stime + ended.ru_utime + ended.ru_stime
    return Moment(time.monotonic(), busy_seconds(), spent)


def others(since: Moment) -> float:
    """Return the cores that others have kept busy since then; of what this process started all must have ended.

    What was started by a process that did not wait for it counts as others'.
    """
    now = moment()
    cores = (now.busy - since.busy - (now.own - since.own)) / (now.at - since.at)
    return round(max(0.0, cores), 2)


def busy_seconds() -> float:
    """Return the seconds for which cores of this machine were busy since it started.

    Those are included in which the machine below this one gave its time to others (steal). To wait for a disk is not
    to be busy.
    """
    fields = Path("/proc/stat").read_text(encoding="ascii").split("\n", 1)[0].split()[1:]
    user, nice, system, _, _, irq, softirq, steal, *_ = map(int, fields)
    return (user + nice + system + irq + softirq + steal) / os.sysconf("SC_CLK_TCK")


def load_before(seconds: float = 2.0) -> float:
    """Return the cores that are busy, over some seconds; asked before a measurement begins.

    No load average: that would hold what was measured the minute before.
    """
    begun = moment()
    time.sleep(seconds)
    return others(begun)


def here(command: str, load: float, others: float = 0.0, before: str | None = None) -> Origin:
    """Return the origin of what has been measured on this machine now.

    `before` is the revision that was there when the measurement began: a program that is started later runs what it
    finds then, so that figures of code that has changed meanwhile belong to no revision.
    """
    versions = {}
    for name in PACKAGES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            continue
    return Origin(
        date=f"{datetime.now(UTC):%Y-%m-%d}",
        machine=f"{processor()} ({platform.machine()})",
        cores=os.cpu_count() or 1,
        memory=os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9,
        system=f"{platform.system()} {platform.release().partition('-')[0]}",
        python=platform.python_version(),
        versions=versions,
        revision=measured_revision(before or revision(), revision()),
        load=round(load, 2),
        others=others,
        command=command,
    )


def save(part: str, origin: Origin, figures: Any, folder: Path = RESULTS) -> Path:
    """Write what a part found. `figures` is a dataclass or a Struct."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{part}.json"
    text = msgspec.json.format(msgspec.json.encode({"origin": origin, "figures": figures}), indent=1)
    fresh = path.with_suffix(".new")
    fresh.write_bytes(text + b"\n")
    fresh.replace(path)
    return path


def load(part: str, kind: type[T], folder: Path = RESULTS) -> tuple[Origin, T]:
    """Read what a part found. Raises FileNotFoundError, and msgspec.ValidationError for a file of another shape."""
    raw = msgspec.json.decode((folder / f"{part}.json").read_bytes())
    return msgspec.convert(raw["origin"], Origin), msgspec.convert(raw["figures"], kind)


def processor() -> str:
    """Return what the kernel calls the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or "unknown processor"


def revision(root: Path = ROOT) -> str:
    """Return the commit that is there; with a `+` behind it if code that can be measured differs from it, or is new."""
    try:
        changed = _git(root, "status", "--porcelain", "--untracked-files=all", "--", *_CODE)
        return _git(root, "rev-parse", "--short=7", "HEAD") + ("+" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def measured_revision(before: str, after: str, root: Path = ROOT) -> str:
    """Return the revision at the begin, with a `+` if the code was another at the end.

    A commit of pages or results is no other code.
    """
    if before == after:
        return before
    try:
        same = "+" not in before + after and not _git(root, "diff", "--name-only", before, after, "--", *_CODE)
    except (OSError, subprocess.CalledProcessError):
        same = False
    return before if same else f"{before.removesuffix('+')}+"


def _git(root: Path, *arguments: str) -> str:
    return subprocess.run(["git", *arguments], cwd=root, capture_output=True, text=True, check=True).stdout.strip()


_CODE: Final = (
    *("schemas", "commd", "bridged", "agentd", "argosy", "benchmarks", "missions", "manifests"),
    *("tests/support", "pyproject.toml", ":(exclude)benchmarks/results"),
)
