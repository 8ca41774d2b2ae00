"""Find the lines of the tables, keys and values of a TOML document, which `tomllib` does not return."""

from __future__ import annotations

import re
from collections import Counter

_PART = r"""(?:[A-Za-z0-9_-]+|"(?:\\.|[^"\\\n])*"|'[^'\n]*')"""
_KEY = re.compile(rf"{_PART}(?:[ \t]*\.[ \t]*{_PART})*")
_PARTS = re.compile(_PART)
_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_STRING = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}|\'\'\'.*?\'{3,5}|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\'',
    re.DOTALL,
)
_BARE = re.compile(r"[^\n#,\[\]{}]*")

Path = tuple[str, ...]
"""Steps to a value: keys, and positions in arrays as text, such as `("actions", "goto", "params", "0", "min")`."""


def toml_lines(text: str) -> dict[Path, int]:
    """Return the line (from 1) of each table, key and element of an array, by its path; the first where it repeats.

    `text` is one that `tomllib` reads; of another text the result may be incomplete. Raises RecursionError for values
    that are nested too deeply.
    """
    scan = _Scan(text)
    scan.document()
    return scan.found


def line_of(lines: dict[Path, int], path: Path) -> int:
    """Return the line of the innermost table, key or element on `path` that is known, 0 if none is.

    `[a.b]` declares `a` too: a table without a line of its own has that of its first part.
    """
    for length in range(len(path), 0, -1):
        known = path[:length]
        if line := lines.get(known) or next((line for at, line in lines.items() if at[:length] == known), 0):
            return line
    return 0


def key_parts(text: str) -> Path:
    """Return the steps of a key in TOML syntax, such as `fields."linear.x"`; none if the text is none."""
    return _parts(text) if _KEY.fullmatch(text) else ()


def _parts(key: str) -> Path:
    return tuple(part.strip("\"'") for part in _PARTS.findall(key))


class _Scan:
    """Goes once through the text."""

    def __init__(self, text: str) -> None:
        self.text, self.at = text, 0
        self.found: dict[Path, int] = {}
        self.line, self.counted = 1, 0
        self.arrays: Counter[Path] = Counter()

    def here(self, path: Path) -> None:
        """Record the present line of the scan as that of `path`."""
        self.line += self.text.count("\n", self.counted, self.at)
        self.counted = self.at
        self.found.setdefault(path, self.line)

    def document(self) -> None:
        table: Path = ()
        while self.blank():
            if self.text[self.at] == "[":
                table = self.header()
            else:
                self.pair(table)
            end = self.text.find("\n", self.at)
            self.at = len(self.text) if end < 0 else end

    def header(self) -> Path:
        """Read `[table]` or `[[array of tables]]`."""
        array = self.text.startswith("[[", self.at)
        start, self.at = self.at, self.at + 1 + array
        self.blank()
        path = self.inside(self.key())
        self.at, end = start, self.at
        self.here(path)
        if array:
            path = (*path, str(self.arrays[path]))
            self.arrays[path[:-1]] += 1
            self.here(path)
        self.at = end
        return path

    def inside(self, path: Path) -> Path:
        """Return the same path through the last elements of the arrays of tables on it."""
        whole: Path = ()
        for step in path[:-1]:
            whole = (*whole, step)
            if count := self.arrays[whole]:
                whole = (*whole, str(count - 1))
        return (*whole, *path[-1:])

    def pair(self, table: Path) -> None:
        """Read `key = value`."""
        start = self.at
        parts = self.key()
        if not parts:
            self.at = start + 1
            return
        end, self.at = self.at, start
        self.here((*table, *parts))
        self.at = end
        self.blank()
        if self.text.startswith("=", self.at):
            self.at += 1
            self.blank()
            self.value((*table, *parts))

    def value(self, path: Path) -> None:
        match self.text[self.at : self.at + 1]:
            case "[":
                self.array(path)
            case "{":
                self.inline_table(path)
            case '"' | "'":
                found = _STRING.match(self.text, self.at)
                self.at = found.end() if found else len(self.text)
            case _:
                found = _BARE.match(self.text, self.at)
                self.at = found.end() if found else len(self.text)

    def array(self, path: Path) -> None:
        self.at += 1
        index = 0
        while self.blank() and self.text[self.at] != "]":
            before = self.at
            self.here((*path, str(index)))
            self.value((*path, str(index)))
            index += 1
            self.comma(before)
        self.at += 1

    def inline_table(self, path: Path) -> None:
        self.at += 1
        while self.blank() and self.text[self.at] != "}":
            before = self.at
            self.pair(path)
            self.comma(before)
        self.at += 1

    def comma(self, before: int) -> None:
        """Pass the comma, if there is one, and go on in any case."""
        if self.blank() and self.text[self.at] == ",":
            self.at += 1
        self.at = max(self.at, before + 1)

    def key(self) -> Path:
        found = _KEY.match(self.text, self.at)
        if found is None:
            return ()
        self.at = found.end()
        return _parts(found[0])

    def blank(self) -> bool:
        """Pass blanks, comments and line ends; returns whether something follows."""
        found = _BLANK.match(self.text, self.at)
        self.at = found.end() if found else self.at
        return self.at < len(self.text)
