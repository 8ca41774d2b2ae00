"""docs/guides/monitoring.md lists the code of every note that a daemon makes, and no other."""

import ast
import importlib
import re
from collections.abc import Iterator
from types import ModuleType

from argosy.cli.remedies import GRAVE, REMEDIES
from tests.support.processes import ROOT

DAEMONS = ("agentd", "bridged", "commd")


def made(node: ast.expr, module: ModuleType) -> Iterator[str]:
    """Yield the codes that the first argument of a `Note(...)` may have."""
    match node:
        case ast.Constant(value=str(code)):
            yield code
        case ast.Name(id=name):
            yield getattr(module, name)
        case ast.IfExp(body=body, orelse=orelse):
            yield from made(body, module)
            yield from made(orelse, module)
        case _:
            raise AssertionError(f"{module.__name__}:{node.lineno}: write the code of a note as a text or a constant")


def codes() -> set[str]:
    found: set[str] = set()
    for path in (path for daemon in DAEMONS for path in (ROOT / daemon).rglob("*.py")):
        text = path.read_text()
        if "Note(" not in text:
            continue
        module = importlib.import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Note":
                found.update(made(node.args[0], module))
    return found


def listed() -> list[str]:
    page = (ROOT / "docs/guides/monitoring.md").read_text()
    table = page.partition("## Codes of notes")[2].partition("\n##")[0]
    rows = [line.split("|")[1] for line in table.splitlines() if line.startswith("| `")]
    return [code for cell in rows for code in re.findall(r"`(\w+)`", cell)]


def test_the_page_lists_every_code_once_and_no_other() -> None:
    assert sorted(listed()) == sorted(codes())


def test_errors_and_remedies_are_of_codes_that_there_are() -> None:
    assert GRAVE | REMEDIES.keys() <= codes()


def test_the_page_marks_the_errors() -> None:
    page = (ROOT / "docs/guides/monitoring.md").read_text()
    assert set(re.findall(r"\| `(\w+)` \|.*\*\*error\*\*", page)) == GRAVE
