"""All texts of errors, refusals, notes and findings in the product, read from its syntax trees.

`python -m tests.support.texts` writes them to `tests/data/texts.txt`, where they are reviewed; `tests/test_texts.py`
compares. Tests of behaviour assert codes and values, so that a text can be improved in one place.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Final, TypeAlias

ROOT: Final = Path(__file__).parents[2]
FILE: Final = ROOT / "tests" / "data" / "texts.txt"
PRODUCT: Final = ("schemas", "commd", "bridged", "agentd", "argosy")
RECORDS: Final = frozenset({"Note", "Refusal", "Finding", "RecorderNote", "Said"})
"""Records that carry a code and a text, or a text."""
MAKERS: Final = frozenset({"wrong", "finding", "problem", "refuse", "complain", "fail"})
"""Functions that make one of them, or print an error."""
TEXTS: Final = frozenset({"text", "reason", "why", "problem", "message"})
"""Arguments that are such a text, whatever is called."""
PRINTED: Final = ("error: ", "warning: ", "note: ")
Scopes: TypeAlias = dict[int, ast.AST]
"""The module or function of each node, by the node's identity."""
HEAD: Final = """\
# Texts of errors, refusals, notes and findings, by the file that makes them; {} stands for a value.
# Written by `python -m tests.support.texts`; read each change aloud: what happened, to whom, what to do?
"""


def all_texts() -> str:
    """Return the contents of the file."""
    parts = [HEAD]
    for package in PRODUCT:
        for path in sorted((ROOT / package).rglob("*.py")):
            if lines := list(dict.fromkeys(texts_of(path.read_text(encoding="utf-8")))):
                parts.append("\n".join([f"## {path.relative_to(ROOT).as_posix()}", *lines, ""]))
    return "\n".join(parts)


def texts_of(source: str) -> Iterator[str]:
    """Yield the kind and the text of each error, refusal, note and finding that a module makes."""
    tree = ast.parse(source)
    scopes = [tree, *(node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))]
    inner: Scopes = {id(node): scope for scope in scopes for node in ast.walk(scope)}  # the innermost one comes last
    raised = {id(node.exc) for node in ast.walk(tree) if isinstance(node, ast.Raise)}
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    for call in sorted(calls, key=lambda one: (one.lineno, one.col_offset)):
        called = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
        named = {one.arg: one.value for one in call.keywords if one.arg is not None}
        everything = [*call.args, *named.values()]
        if id(call) in raised or called in RECORDS | MAKERS:
            told = everything
        elif called == "print":
            told = [one for one in call.args if any(text.startswith(PRINTED) for text in _wordings(one, [], inner))]
        else:
            told = [value for name, value in named.items() if name in TEXTS]
        code = next((ast.literal_eval(one) for one in everything if _is_code(one)), "")
        for text in (text for one in told for text in _wordings(one, [], inner)):
            if " " in text.strip() and any(map(str.isalpha, _without_values(text))):
                yield f"{called}{f' {code}' if code else ''}: {text}"


def _is_code(node: ast.AST) -> bool:
    """Whether an expression is a constant such as `link_down`."""
    match node:
        case ast.Constant(value=str(code)):
            return code.replace("_", "").replace("-", "").isalpha() and code.islower()
    return False


def _without_values(text: str) -> str:
    return "".join(part.rpartition("}")[2] for part in text.split("{"))


def _wordings(node: ast.AST, seen: list[str], inner: Scopes) -> list[str]:
    """Return the texts that an expression may be; a local name stands for what is assigned to it."""
    match node:
        case ast.Constant(value=str(text)):
            return [text]
        case ast.JoinedStr(values=parts):
            return ["".join(_part(part) for part in parts)]
        case ast.IfExp(body=body, orelse=orelse):
            return [*_wordings(body, seen, inner), *_wordings(orelse, seen, inner)]
        case ast.BoolOp(values=values):
            return [text for value in values for text in _wordings(value, seen, inner)]
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            begins, ends = (_wordings(side, seen, inner) or ["{}"] for side in (left, right))
            return [begin + end for begin in begins for end in ends]
        case ast.Tuple(elts=parts) | ast.List(elts=parts):
            return [text for part in parts for text in _wordings(part, seen, inner)]
        case ast.Name(id=name) if name not in seen:
            scope = inner.get(id(node))
            assigned = (
                []
                if scope is None
                else [
                    one.value
                    for one in ast.walk(scope)
                    if isinstance(one, ast.Assign)
                    and any(isinstance(at, ast.Name) and at.id == name for at in one.targets)
                ]
            )
            return [text for value in assigned for text in _wordings(value, [*seen, name], inner)]
    return []


def _part(part: ast.AST) -> str:
    match part:
        case ast.Constant(value=str(text)):
            return text
        case ast.FormattedValue(value=ast.Name(id=name) | ast.Attribute(attr=name)):
            return f"{{{name}}}"
    return "{}"


if __name__ == "__main__":
    FILE.write_text(all_texts(), encoding="utf-8")
