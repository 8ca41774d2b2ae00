"""The report of the soak tests, docs/measurements/soak.md: a section per test, each written by the test when it has
run."""

import os
import platform
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from benchmarks.results import processor

ROOT = Path(__file__).parents[2]
REPORT = ROOT / "docs/measurements/soak.md"


@dataclass(kw_only=True)
class Judged:
    """A row of a table of measurements, and whether it is as it must be."""

    seen: list[str] = field(default_factory=list)
    """What was seen, with figures."""
    problems: list[str] = field(default_factory=list)
    """What is not as it must be; empty = the row holds."""

    def expect(self, holds: object, wish: str) -> None:
        """Note a wish that is not fulfilled."""
        if not holds:
            self.problems.append(f"not so: {wish}")


def write_section(title: str, lines: list[str], report: Path = REPORT) -> None:
    """Put a section in place of the one with this title, or at the end; the other sections stay as they are."""
    sections = _sections(report.read_text(encoding="utf-8")) if report.exists() else {}
    sections[title] = "\n".join([f"On {here()}.", "", *lines])
    body = "\n\n".join(f"## {name}\n\n{text}" for name, text in sections.items())
    report.write_text(f"# Soak\n\nWhat `make soak` found: tests that take longer than CI may.\n\n{body}\n", "utf-8")


def _sections(text: str) -> dict[str, str]:
    parts = re.split(r"^## (.*)\n", text, flags=re.MULTILINE)[1:]
    return {title: body.strip() for title, body in zip(parts[::2], parts[1::2], strict=True)}


def table(head: str, rows: Iterable[Sequence[object]]) -> list[str]:
    """Return a table in Markdown; `head` has the titles of its columns, such as `fault | seen`."""
    lines = [f"| {head} |", "|" + "---|" * len(head.split("|"))]
    for cells in rows:
        lines.append("| " + " | ".join(str(cell).replace("|", "\\|").replace("\n", " ") for cell in cells) + " |")
    return lines


def here() -> str:
    """Return when and on what a report was made."""
    return (
        f"{datetime.now(UTC):%Y-%m-%d}: Python {platform.python_version()}, {os.cpu_count()} cores of "
        f"{processor()} ({platform.machine()}), eclipse-zenoh {version('eclipse-zenoh')}, "
        f"pymavlink {version('pymavlink')}"
    )
