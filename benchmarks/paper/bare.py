"""Programs without what is written for people: comments, docstrings and blank lines."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from typing import Final

_ASL: Final = re.compile(r'(?P<kept>"(?:[^"\\]|\\.)*")|/\*.*?\*/|//[^\n]*', re.DOTALL)


def bare_agentspeak(text: str) -> str:
    """Return an AgentSpeak program without comments and blank lines."""
    return _filled_lines(_ASL.sub(lambda found: found["kept"] or "", text))


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
