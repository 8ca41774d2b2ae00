"""The figures of README and docs: each block of a page between two marks is written from a part's results.

    <!-- figures NAME -->
    ...
    <!-- end of figures -->

A part says which blocks it fills (`blocks`) and which pictures it draws (`pictures`). Nothing between the marks is
typed by hand, and `tests/benchmarks/test_pages.py` holds the pages against the results.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final

from benchmarks.results import ROOT

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
    """Return the blocks that pages have, and where each stands."""
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


def table(head: str, rows: Iterable[str] = ()) -> list[str]:
    """Return the lines of a table: its head, the rule below it, and its rows, each as `| cell | cell |`."""
    return [head, "|" + "---|" * (head.count("|") - 1), *rows]


def section(name: str, root: Path = ROOT) -> str:
    """Return where a block stands, as a link from a page in docs/measurements: the page, and the heading above it.

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
