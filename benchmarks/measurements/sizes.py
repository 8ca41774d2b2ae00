"""Part `sizes`: the sizes of the programs of the paper's missions, AgentSpeak beside imperative Python (tables 4, 6).

The paper's measures: bytes of the source files compressed by gzip, lines and words, summed over the files of all
agents. A file that several agents run counts once. Not counted for either side: the mission file, the manifests, and
the start of a program with its values.
"""

from __future__ import annotations

import ast
import gzip
import io
import re
import tokenize
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.parts import Goal, table
from benchmarks.peers import TABLE_4, TABLE_6, Size
from benchmarks.processes import BenchmarkFailed
from benchmarks.results import ROOT, Origin

_COMMENT: Final = re.compile(r'(?P<kept>"(?:[^"\\]|\\.)*")|/\*.*?\*/|//[^\n]*', re.DOTALL)


def bare_agentspeak(text: str) -> str:
    """Return an AgentSpeak program without comments and blank lines."""
    return _filled_lines(_COMMENT.sub(lambda found: found["kept"] or "", text))


def bare_python(text: str) -> str:
    """Return a Python program without comments, docstrings and blank lines; a body of a docstring alone is `...`."""
    lines = text.splitlines()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            row, column = token.start
            lines[row - 1] = lines[row - 1][:column]
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            _without_docstring(node, lines)
    return _filled_lines("\n".join(lines))


def _without_docstring(
    node: ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef, lines: list[str]
) -> None:
    if ast.get_docstring(node) is None:
        return
    text = node.body[0]
    assert text.end_lineno is not None
    rest = "..." if len(node.body) == 1 and not isinstance(node, ast.Module) else ""
    indent = lines[text.lineno - 1][: text.col_offset]
    lines[text.lineno - 1 : text.end_lineno] = [indent + rest, *[""] * (text.end_lineno - text.lineno)]


def _filled_lines(text: str) -> str:
    return "".join(f"{line.rstrip()}\n" for line in text.splitlines() if line.strip())


LEVEL: Final = 6
"""Of gzip, its default. No name and no time of the file are in what is counted."""
BARE: Final = {".asl": bare_agentspeak, ".py": bare_python}
MEASURES: Final = {"bytes": "size (bytes)", "lines": "lines", "words": "words"}
WAYS: Final = {"whole": "as they are", "bare": "without comments, docstrings and blank lines"}
AGENTSPEAK, PYTHON = "AgentSpeak", "Python"


@dataclass(frozen=True)
class Mission:
    """A mission and its programs by approach; an agent's program is the list of its files."""

    title: str
    table: int
    """Of the paper."""
    paper: dict[str, Size]
    agents: dict[str, dict[str, tuple[str, ...]]]


_ASL, _PY = "missions/search_and_rescue/{}.asl", "benchmarks/imperative/{}.py"


def _team(pattern: str) -> dict[str, tuple[str, ...]]:
    flying = pattern.format("flying")
    rescuer = (pattern.format("rescuer"), flying)
    return {"scout": (pattern.format("scout"), flying), "rescuer1": rescuer, "rescuer2": rescuer}


MISSIONS: Final = {
    "single_uav": Mission(
        "the single-UAV mission",
        4,
        TABLE_4,
        {
            AGENTSPEAK: {"uav": ("missions/single_uav/uav.asl",)},
            PYTHON: {"uav": ("benchmarks/imperative/single_uav.py",)},
        },
    ),
    "search_and_rescue": Mission("search and rescue", 6, TABLE_6, {AGENTSPEAK: _team(_ASL), PYTHON: _team(_PY)}),
}


@dataclass(frozen=True)
class Source:
    """One file of a program, by both ways of counting."""

    file: str
    whole: Size
    bare: Size
    """Without comments, docstrings and blank lines."""


@dataclass(frozen=True)
class Figures:
    """The sources of each mission and approach, each file once."""

    sources: dict[str, dict[str, list[Source]]]

    def total(self, mission: str, approach: str, way: str) -> Size:
        """Sum a mission's sources; the way of counting is `whole` or `bare`."""
        return _sum(getattr(one, way) for one in self.sources[mission][approach])


def measure(quick: bool) -> Figures:
    """Count; there is nothing to be quick about. Raises BenchmarkFailed."""
    found: dict[str, dict[str, list[Source]]] = {}
    for name, mission in MISSIONS.items():
        found[name] = {}
        for approach, agents in mission.agents.items():
            files = dict.fromkeys(file for files in agents.values() for file in files)
            found[name][approach] = [_source(file) for file in files]
    return Figures(found)


def count(text: str) -> Size:
    """Count a text as `gzip` and `wc` do."""
    packed = gzip.compress(text.encode(), LEVEL, mtime=0)
    return Size(bytes=len(packed), lines=text.count("\n"), words=len(text.split()))


def _source(file: str) -> Source:
    try:
        text = (ROOT / file).read_text(encoding="utf-8")
    except OSError as error:
        raise BenchmarkFailed(f"{file}: {error.strerror}") from None
    return Source(file, count(text), count(BARE[Path(file).suffix](text)))


def _sum(sizes: Iterable[Size]) -> Size:
    found = list(sizes)
    return Size(sum(one.bytes for one in found), sum(one.lines for one in found), sum(one.words for one in found))


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the block `paper-sizes`."""
    lines = [origin.line(), ""]
    for name, mission in MISSIONS.items():
        lines += [
            f"**Table {mission.table}**, programs of {mission.title}:",
            "",
            *table(f"| | {' | '.join(MEASURES.values())} |"),
            *_rows("paper", mission.paper["Jason"], mission.paper["Python"], "Jason"),
            *(row for way, words in WAYS.items() for row in _rows(words, *_pair(figures, name, way))),
        ]
        lines.append("")
    lines += [*_READING, "", *table("| file | as it is: bytes, lines, words | bare |")]
    for of_mission in figures.sources.values():
        for sources in of_mission.values():
            lines += [f"| `{one.file}` | {_listed(one.whole)} | {_listed(one.bare)} |" for one in sources]
    return {"paper-sizes": "\n".join(lines)}


_READING: Final = (
    "Lines depend on how a program is set: the AgentSpeak of search and rescue has several steps of a plan on a line. "
    "Compressed bytes and words do not. An action that fails raises nothing in `commd.client`, so the Python programs "
    "make an exception of its status by a class and a function of their own.",
)
_WHY: Final = "the programs were written to be read, and nothing was tried to make them shorter than the others"


def _pair(figures: Figures, mission: str, way: str) -> tuple[Size, Size]:
    return figures.total(mission, AGENTSPEAK, way), figures.total(mission, PYTHON, way)


def _rows(title: str, agents: Size, python: Size, first: str = AGENTSPEAK) -> list[str]:
    shares = (f"{getattr(agents, one) / getattr(python, one):.2f}" for one in MEASURES)
    return [
        f"| {title}: {first} | {_cells(agents)} |",
        f"| {title}: Python | {_cells(python)} |",
        f"| {title}: {first} / Python | {' | '.join(shares)} |",
    ]


def _cells(size: Size) -> str:
    return " | ".join(str(getattr(size, one)) for one in MEASURES)


def _listed(size: Size) -> str:
    return ", ".join(str(getattr(size, one)) for one in MEASURES)


def goals(figures: Figures) -> list[Goal]:
    """Return one goal for each mission and way of counting: smaller by all three measures."""
    found = []
    for name, mission in MISSIONS.items():
        for way, words in WAYS.items():
            agents, python = _pair(figures, name, way)
            pairs = [(one, getattr(agents, one), getattr(python, one)) for one in MEASURES]
            larger = [f"{one} are not" for one, ours, theirs in pairs if ours >= theirs]
            found.append(
                Goal(
                    title=f"programs of {mission.title}, {words}",
                    wanted="AgentSpeak smaller than Python in bytes, lines and words",
                    found=", ".join(f"{ours} / {theirs} {one}" for one, ours, theirs in pairs),
                    met=not larger,
                    why=f"{', '.join(larger)}: {_WHY}" if larger else "",
                )
            )
    return found
