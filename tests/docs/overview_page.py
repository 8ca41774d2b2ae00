"""The references of docs/architecture/overview.md to lines of the code: `python -m tests.docs.overview_page`.

A reference is a file and, in parentheses, names of it: classes, functions and constants. The first one's line follows
the file's name.
"""

import ast
import re
from collections.abc import Iterator
from functools import cache

from tests.docs.pages import ROOT

PAGE = ROOT / "docs/architecture/overview.md"
REFERENCE = re.compile(r"`([a-z]\w*(?:/\w+)+\.py)(?::\d+)?` \(((?:`[\w.]+`(?:, )?)+)\)")


def written(page: str) -> str:
    """Return the page with the lines of the code as it is. Raises KeyError for a name that a file does not have."""

    def reference(found: re.Match[str]) -> str:
        file, names = found[1], re.findall(r"[\w.]+", found[2])
        lines = [lines_of(file)[name] for name in names]
        return f"`{file}:{lines[0]}` ({found[2]})"

    return REFERENCE.sub(reference, page)


@cache
def lines_of(file: str) -> dict[str, int]:
    """Return the lines of a file's classes, functions and constants, those within a class with its name before them."""
    return dict(_lines(ast.parse((ROOT / file).read_text(encoding="utf-8")), ""))


def _lines(of: ast.Module | ast.ClassDef, prefix: str) -> Iterator[tuple[str, int]]:
    for node in of.body:
        match node:
            case ast.ClassDef(name=name):
                yield prefix + name, node.lineno
                yield from _lines(node, f"{prefix}{name}.")
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                yield prefix + name, node.lineno
            case ast.AnnAssign(target=ast.Name(id=name)):
                yield prefix + name, node.lineno
            case ast.Assign(targets=targets):
                for target in targets:
                    yield from ((one.id, node.lineno) for one in ast.walk(target) if isinstance(one, ast.Name))


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
