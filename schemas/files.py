"""Reads the files that people write: text in UTF-8, of a size that a person could have written."""

from __future__ import annotations

from pathlib import Path

from schemas.findings import Finding, Findings

MAX_FILE = 1_000_000
"""Bytes; a mission or manifest is a few thousand."""


def read_text(path: Path) -> str:
    """Return the text of a file. Raises Findings if it cannot be read, is too large, or is no text."""
    try:
        with path.open("rb") as file:
            content = file.read(MAX_FILE + 1)
    except OSError as error:
        raise Findings([Finding(str(path), 0, 0, f"cannot be read: {error.strerror}")]) from None
    if len(content) > MAX_FILE:
        raise Findings([Finding(str(path), 0, 0, f"larger than {MAX_FILE} bytes: not a file of this kind")])
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise Findings([Finding(str(path), line, 0, "expected UTF-8 text")]) from None
