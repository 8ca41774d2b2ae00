"""Write the figures of README and docs: each block of a page between two marks comes from a part's results.

    <!-- figures NAME -->
    ...
    <!-- end of figures -->

A part has the text of its blocks (`blocks`) and its pictures (`pictures`). Nothing between the marks is typed by hand,
and `tests/benchmarks/test_pages.py` compares the pages with the results. Tables of several parts' results, such as all
goals and README's table, are made here (`of_several`).
"""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec

from benchmarks import peers
from benchmarks.parts import PARTS, Part, goal_rows, table
from benchmarks.results import ROOT, Origin, load

PICTURES: Final = ROOT / "docs/measurements/figures"
_BLOCK: Final = re.compile(
    r"(?P<begin><!-- figures (?P<name>[\w-]+) -->\n)(?P<text>.*?)(?P<end><!-- end of figures -->)", re.DOTALL
)


_HEADING: Final = re.compile(r"^#+ .*$", re.MULTILINE)


def pages(root: Path = ROOT) -> Iterator[Path]:
    """Return the pages that may have blocks."""
    yield root / "README.md"
    yield from sorted((root / "docs").rglob("*.md"))


def names(root: Path = ROOT) -> dict[str, list[Path]]:
    """Return the blocks that pages have, and the pages of each."""
    found: dict[str, list[Path]] = {}
    for page in pages(root):
        for block in _BLOCK.finditer(page.read_text(encoding="utf-8")):
            found.setdefault(block["name"], []).append(page)
    return found


def filled(text: str, blocks: Mapping[str, str]) -> str:
    """Return a page's text with its blocks written anew; those that `blocks` does not have stay as they are."""

    def fill(block: re.Match[str]) -> str:
        written = blocks.get(block["name"])
        inner = block["text"] if written is None else f"\n{written.strip()}\n\n"
        return f"{block['begin']}{inner}{block['end']}"

    return _BLOCK.sub(fill, text)


def write(blocks: Mapping[str, str], root: Path = ROOT) -> list[Path]:
    """Write blocks into the pages where they stand. Returns the pages that changed; raises KeyError for lost blocks."""
    if lost := sorted(blocks.keys() - names(root).keys()):
        raise KeyError(f"no page has the mark <!-- figures {lost[0]} -->")
    changed = []
    for page in pages(root):
        text = page.read_text(encoding="utf-8")
        if (new := filled(text, blocks)) != text:
            page.write_text(new, encoding="utf-8")
            changed.append(page)
    return changed


def section(name: str, root: Path = ROOT) -> str:
    """Return the place of a block, as a link from a page in docs/measurements: the page, and the heading above it.

    Of several places the first in docs. Raises KeyError for a lost block.
    """
    for page in names(root).get(name, []):
        if root / "docs" in page.parents:
            before = page.read_text(encoding="utf-8").partition(f"<!-- figures {name} -->")[0]
            level, _, title = _HEADING.findall(before)[-1].partition(" ")
            path = os.path.relpath(page, root / "docs/measurements")
            return path if level == "#" else f"{path}#{_anchor(title)}"
    raise KeyError(f"no page of docs has the mark <!-- figures {name} -->")


def _anchor(title: str) -> str:
    """As the site makes them of headings."""
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", title).strip().lower())


def write_pictures(pictures: Mapping[str, str], folder: Path = PICTURES) -> None:
    """Write pictures, each an SVG text by its name without suffix."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, svg in pictures.items():
        (folder / f"{name}.svg").write_text(svg, encoding="utf-8")


BUSY = 0.5
"""Cores that others may keep busy before figures are marked as those of a busy machine."""
Found = tuple[Origin, Any]
"""Where the figures of a part come from, and the figures."""


def of_several(parts: Sequence[Part] = PARTS) -> dict[str, str]:
    """Return them, of those parts that have results."""
    found = {one: loaded for one in parts if (loaded := found_of(one)) is not None}
    goals = [row for one in parts for row in _goals(one, found.get(one))]
    short = [row for one, (_, figures) in found.items() for row in one.rows("in_short", figures)]
    return {
        "goals": "\n".join(table("| part | figure | goal | measured | |", goals)),
        "in-short": "\n".join(table("| measured | Argosy | others |", short)),
        "comparison-board": comparison_board(found),
    }


def found_of(one: Part) -> Found | None:
    """Return what a part found; None when it has no results of the shape that it has now."""
    with contextlib.suppress(FileNotFoundError, msgspec.DecodeError, ImportError):
        return load(one.name, one.module().Figures)
    return None


def _goals(one: Part, found: Found | None) -> list[str]:
    """Return the rows of a part, with a link to its first block."""
    if found is None:
        return [f"| {one.name} | | | | **not measured** |"]
    origin, figures = found
    name = one.name
    with contextlib.suppress(KeyError):
        name = f"[{name}]({section(next(iter(one.module().blocks(origin, figures))))})"
    return goal_rows(one.goals(figures), part=name, busy=max(origin.load, origin.others) > BUSY)


def comparison_board(found: dict[Part, Found]) -> str:
    """Return the table of docs/measurements/benchmarks.md about the memory of a board, beside what the paper's
    authors published."""
    low, high, python_low, python_high, agent_low, agent_high = (
        f"{peers.mb(value):.0f}"
        for value in (*peers.JASON_BOARD, *peers.PYTHON_BOARD, *peers.PROCESSES["Jason agent"].memory)
    )
    jason, python = peers.TABLE_3["Jason"], peers.TABLE_3["Python"]
    rows = [
        f"| the paper's nodes in all: agent, HwBridge, Comm, mavros, roscore | {low} to {high} MB, of it the "
        f"agent {agent_low} to {agent_high} | Raspberry Pi 3 | measurements published with the paper |",
        f"| the same with a Python program in the agent's place | {python_low} to "
        f"{python_high} MB | Raspberry Pi 3 | the same |",
        f"| the paper's board with its agent; with a Python program | {jason.memory.mean:.2f} % of the memory, "
        f"{jason.cpu.mean:.2f} % CPU; {python.memory.mean:.2f} %, {python.cpu.mean:.2f} % | Raspberry Pi 3 "
        "| the paper, table 3 |",
    ]
    rows += [row for one, (_, figures) in found.items() for row in one.rows("in_comparison", figures)]
    return "\n".join(table("| what | figure | machine | source |", rows))
