"""What a part of the benchmarks found, in a file of its own: the figures, and on which machine, when and by what.

`benchmarks/results/PART.json` is what pages and pictures are made of (`benchmarks.pages`): no figure is typed by hand.
"""

from __future__ import annotations

import os
import platform
import subprocess
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec

T = TypeVar("T")

ROOT: Final = Path(__file__).parent.parent
RESULTS: Final = Path(__file__).parent / "results"
PACKAGES: Final = ("argosy", "eclipse-zenoh", "msgspec", "pymavlink", "psutil", "agentspeak")
"""Whose versions are told."""


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
    """Of the code that was measured; with a `+` behind it files had been changed."""
    load: float
    """Load average of the last minute before the measurement: above 1 somebody else was at work."""
    command: str

    def line(self) -> str:
        """Return it as a sentence for a page."""
        versions = ", ".join(f"{name} {number}" for name, number in self.versions.items() if name != "argosy")
        return (
            f"Measured by `{self.command}` on {self.date}: {self.cores} cores of {self.machine}, {self.memory:.0f} GB, "
            f"{self.system}, Python {self.python}, {versions}; Argosy at {self.revision}; "
            f"load before the run {self.load:.1f}."
        )


def load_before() -> float:
    """Return the load average of the last minute; asked before a measurement begins."""
    return os.getloadavg()[0]


def here(command: str, load: float) -> Origin:
    """Return the origin of what is measured on this machine now."""
    versions = {}
    for name in PACKAGES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            continue
    return Origin(
        date=f"{datetime.now(UTC):%Y-%m-%d}",
        machine=f"{_processor()} ({platform.machine()})",
        cores=os.cpu_count() or 1,
        memory=os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9,
        system=f"{platform.system()} {platform.release().partition('-')[0]}",
        python=platform.python_version(),
        versions=versions,
        revision=_revision(),
        load=round(load, 2),
        command=command,
    )


def save(part: str, origin: Origin, figures: Any, folder: Path = RESULTS) -> Path:
    """Write what a part found. `figures` is a dataclass or a Struct."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{part}.json"
    text = msgspec.json.format(msgspec.json.encode({"origin": origin, "figures": figures}), indent=1)
    path.write_bytes(text + b"\n")
    return path


def load(part: str, kind: type[T], folder: Path = RESULTS) -> tuple[Origin, T]:
    """Read what a part found. Raises FileNotFoundError, and msgspec.ValidationError for a file of another shape."""
    raw = msgspec.json.decode((folder / f"{part}.json").read_bytes())
    return msgspec.convert(raw["origin"], Origin), msgspec.convert(raw["figures"], kind)


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or "unknown processor"


def _revision() -> str:
    def git(*arguments: str) -> str:
        return subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()

    try:
        changed = git("status", "--porcelain", "--untracked-files=no", "--", *_CODE)
        return git("rev-parse", "--short=7", "HEAD") + ("+" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


_CODE: Final = ("schemas", "commd", "bridged", "agentd", "argosy", "benchmarks/*.py", "missions", "manifests")
