"""The figures of README and docs: each block of a page between two marks is written from a part's results.

    <!-- figures NAME -->
    ...
    <!-- end of figures -->

A part says which blocks it fills (`blocks`) and which pictures it draws (`pictures`). Nothing between the marks is
typed by hand, and `tests/benchmarks/test_pages.py` holds the pages against the results.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

from benchmarks.results import ROOT

PICTURES: Final = ROOT / "docs" / "figures"
_BLOCK: Final = re.compile(
    r"(?P<begin><!-- figures (?P<name>[\w-]+) -->\n)(?P<text>.*?)(?P<end><!-- end of figures -->)", re.DOTALL
)


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


def write_pictures(pictures: Mapping[str, str], folder: Path = PICTURES) -> None:
    """Write pictures, each an SVG text by its name without suffix."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, svg in pictures.items():
        (folder / f"{name}.svg").write_text(svg, encoding="utf-8")
