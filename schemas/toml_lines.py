"""Finds the lines on which the tables and keys of a TOML document stand, which `tomllib` does not tell."""

from __future__ import annotations

import re

_PART = r"""(?:[A-Za-z0-9_-]+|"[^"\n]*"|'[^'\n]*')"""
_PATH = rf"{_PART}(?:\s*\.\s*{_PART})*"
_HEADER = re.compile(rf"\s*\[\[?\s*({_PATH})\s*\]")
_KEY = re.compile(rf"\s*({_PATH})\s*=")
_PARTS = re.compile(_PART)
_TOKEN = re.compile(r'"""|\'\'\'|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\'|#[^\n]*|[\[\]{}]')

Path = tuple[str, ...]


def toml_lines(text: str) -> dict[Path, int]:
    """Return the line (from 1) of each table and each key of `text`, by its path; the first one where it repeats.

    Keys inside inline tables stand on the line of the key that holds them, so they are not listed.
    """
    found: dict[Path, int] = {}
    table: Path = ()
    depth, quote = 0, ""
    for number, line in enumerate(text.splitlines(), start=1):
        value = line
        if not depth and not quote:
            if header := _HEADER.match(line):
                table = _parts(header[1])
                found.setdefault(table, number)
                continue
            if key := _KEY.match(line):
                found.setdefault(table + _parts(key[1]), number)
                value = line[key.end() :]
        depth, quote = _scan(value, depth, quote)
    return found


def line_of(lines: dict[Path, int], path: Path) -> int:
    """Return the line of the innermost table or key on `path` that is known, 0 if none is.

    `[a.b]` declares `a` too: a table without a line of its own stands where its first part does.
    """
    for length in range(len(path), 0, -1):
        known = path[:length]
        if line := lines.get(known) or next((line for at, line in lines.items() if at[:length] == known), 0):
            return line
    return 0


def _parts(path: str) -> Path:
    return tuple(part.strip("\"'") for part in _PARTS.findall(path))


def _scan(value: str, depth: int, quote: str) -> tuple[int, str]:
    """How deep in brackets, and in which multi-line string, the text is after `value`."""
    at = 0
    while at < len(value):
        if quote:
            end = value.find(quote, at)
            if end < 0:
                return depth, quote
            at, quote = end + 3, ""
            continue
        token = _TOKEN.search(value, at)
        if token is None:
            break
        at = token.end()
        match token[0]:
            case '"""' | "'''":
                quote = token[0]
            case "[" | "{":
                depth += 1
            case "]" | "}":
                depth = max(0, depth - 1)
    return depth, quote
