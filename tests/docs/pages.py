"""The pages of the documentation and what stands in their fences.

How blocks are written, so that they are checked (docs may hold no other kind of block):

- ```` ```sh ````: commands. Each must end with exit code 0, unless the next one reads `$?`.
- ```` ```console ````: commands after `$ `, each followed by what it prints. A line `...` stands for any lines, `...`
  within a line for any text; times of day and figures with a decimal point may be others.
- `asl`, `mas2j`, `python`, `toml`, `yaml`, `json`, `json5`: must be well-formed. With `title="NAME"`, or a first line
  that is a comment with a file's name and nothing else, it is that file in the reader's folder.
- `diff` with a title: an edit of that file: the lines with ` ` and `-` are found in it, once.
- `ini` with a title is a file too; `text` is output or a drawing and is not looked at.
"""

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
COMMANDS = frozenset({"sh", "console"})
LANGUAGES = COMMANDS | {"asl", "python", "toml", "yaml", "json", "json5", "ini", "mas2j", "diff", "text"}
_FENCE = re.compile(r"^(?P<indent> *)```(?P<info>[^`\n]*)\n(?P<text>.*?)^(?P=indent)```$", re.MULTILINE | re.DOTALL)
_TITLE = re.compile(r'title="([^"]+)"')
_FILE = re.compile(r"(?:#|//) ([\w./-]+\.[a-z0-9]+)\n")


@dataclass(frozen=True)
class Block:
    """One fenced block."""

    page: str
    line: int
    language: str
    title: str
    text: str

    @property
    def where(self) -> str:
        return f"{self.page}:{self.line}"


def part_of(page: Path, name: str) -> str:
    """Return the text between the marks `<!-- NAME -->` and `<!-- end of NAME -->` of a page. Raises ValueError."""
    return _split(page, name)[1]


def with_part(page: Path, name: str, part: str) -> str:
    """Return the text of a page with another part between the marks of that name. Raises ValueError."""
    before, _, after = _split(page, name)
    return before + part + after


def _split(page: Path, name: str) -> tuple[str, str, str]:
    text, begin, end = page.read_text(encoding="utf-8"), f"<!-- {name} -->\n", f"<!-- end of {name} -->"
    first = text.index(begin) + len(begin)
    last = text.index(end, first)
    return text[:first], text[first:last], text[last:]


def pages() -> list[str]:
    """All pages, as paths from the root of the checkout."""
    found = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    return sorted(str(path.relative_to(ROOT)) for path in found)


@cache
def text_of(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


@cache
def blocks(page: str) -> tuple[Block, ...]:
    """The fenced blocks of a page, in order."""
    return tuple(_block(page, match) for match in _FENCE.finditer(text_of(page)))


def without_blocks(page: str) -> str:
    """The page with its fenced blocks emptied, every line at its place."""
    return _FENCE.sub(lambda match: "\n" * match[0].count("\n"), text_of(page))


def _block(page: str, match: re.Match[str]) -> Block:
    language, _, rest = match["info"].strip().partition(" ")
    text = "".join(line.removeprefix(match["indent"]) for line in match["text"].splitlines(keepends=True))
    named = _TITLE.search(rest) or _FILE.match(text)
    line = match.string.count("\n", 0, match.start()) + 1
    return Block(page, line, language, named[1] if named else "", text)
