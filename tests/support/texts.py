"""All texts of errors, refusals, outcomes, notes and findings in the product, read from its syntax trees.

`python -m tests.support.texts` writes them to `tests/data/texts.txt`, where they are reviewed; `tests/test_texts.py`
compares. Tests of behaviour assert codes and values, so that a text can be improved in one place.
"""

from __future__ import annotations

import ast
from collections import deque
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
FILE: Final = ROOT / "tests" / "data" / "texts.txt"
PRODUCT: Final = ("schemas", "commd", "bridged", "agentd", "argosy")
RECORDS: Final = frozenset({"Note", "Refusal", "Finding", "RecorderNote", "Diagnosis", "Outcome"})
"""Records that carry a code and a text, or a text."""
MAKERS: Final = frozenset({"wrong", "finding", "problem", "refuse", "complain", "fail"})
"""Functions that make one of them, or print an error."""
TEXTS: Final = frozenset({"text", "reason", "why", "problem", "message"})
"""Arguments that are such a text, whatever is called."""
PRINTED: Final = ("error: ", "warning: ", "note: ")
HEAD: Final = """\
# Texts of errors, refusals, outcomes, notes and findings, by the file that makes them; {} stands for a value.
# Written by `python -m tests.support.texts`; read each change aloud: what happened, to whom, what to do?
"""


def all_texts() -> str:
    """Return the contents of the file."""
    paths = [path for package in PRODUCT for path in sorted((ROOT / package).rglob("*.py"))]
    modules = [Module(path.read_text(encoding="utf-8")) for path in paths]
    makers = makers_of(modules)
    parts = [HEAD]
    for path, module in zip(paths, modules, strict=True):
        if lines := list(dict.fromkeys(module.texts(makers))):
            parts.append("\n".join([f"## {path.relative_to(ROOT).as_posix()}", *lines, ""]))
    return "\n".join(parts)


def makers_of(modules: Collection[Module]) -> set[str]:
    """Return the names of the functions and properties whose text becomes one of those that `Module.texts` yields."""
    makers = set[str]()
    while True:
        for module in modules:
            deque(module.texts(makers), maxlen=0)
        if not (found := set[str]().union(*(module.asked for module in modules)) - makers):
            return makers
        makers |= found


class Module:
    """The syntax tree of a module, read for its texts."""

    def __init__(self, source: str) -> None:
        tree = ast.parse(source)
        nodes = list(ast.walk(tree))
        functions = [node for node in nodes if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
        self._inner = {id(node): scope for scope in (tree, *functions) for node in ast.walk(scope)}
        """The module or function of each node, by the node's identity: the innermost one comes last."""
        self._raised = {id(node.exc) for node in nodes if isinstance(node, ast.Raise)}
        self._assigned: dict[tuple[int, str], list[ast.expr]] = {}
        """What is assigned to a name in a function, by its identity."""
        for node in nodes:
            if isinstance(node, ast.Assign | ast.NamedExpr):
                for at in node.targets if isinstance(node, ast.Assign) else [node.target]:
                    if isinstance(at, ast.Name):
                        self._assigned.setdefault((id(self._inner[id(node)]), at.id), []).append(node.value)
        sources = [node for node in nodes if isinstance(node, ast.Call | ast.Return)]
        self._sources = sorted(sources, key=lambda one: (one.lineno, one.col_offset))
        self.asked = set[str]()
        """The names of the functions and properties that give a text of those that `texts` has found."""

    def texts(self, makers: Collection[str]) -> Iterator[str]:
        """Yield the kind and the text of each error, refusal, outcome, note and finding, and of `makers`."""
        for node in self._sources:
            kind, found = self._of_call(node) if isinstance(node, ast.Call) else self._of_return(node, makers)
            leaves = [leaf for one in found for leaf in self._leaves(one)]
            self.asked.update(name for leaf in leaves if (name := _called(leaf)))
            for text in (text for leaf in leaves for text in self._texts_of(leaf)):
                if " " in text.strip() and any(map(str.isalpha, _without_values(text))):
                    yield f"{kind}: {text}"

    def _of_call(self, call: ast.Call) -> tuple[str, list[ast.expr]]:
        """Return what is called, with the code that it is given, and those of its arguments that are texts."""
        called = _called(call)
        named = {one.arg: one.value for one in call.keywords if one.arg is not None}
        everything = [*call.args, *named.values()]
        if id(call) in self._raised or called in RECORDS | MAKERS:
            found = everything
        elif called == "print":
            found = [one for one in call.args if any(text.startswith(PRINTED) for text in self._wordings(one))]
        else:
            found = [value for name, value in named.items() if name in TEXTS]
        code = next((ast.literal_eval(one) for one in everything if _is_code(one)), "")
        return f"{called} {code}".rstrip(), found

    def _of_return(self, node: ast.Return, makers: Collection[str]) -> tuple[str, list[ast.expr]]:
        """Return the function and what it returns, if it is one of `makers`; a private one must be asked here."""
        match self._inner[id(node)], node.value:
            case ast.FunctionDef(name=name, returns=ast.expr() as type_) | ast.AsyncFunctionDef(
                name=name, returns=ast.expr() as type_
            ), ast.expr() as value:
                private = name.startswith("_")
                if name in (self.asked if private else makers) and ast.unparse(type_) in {"str", "str | None"}:
                    return f"{name} returns", [value]
        return "", []

    def _leaves(self, node: ast.expr, seen: Collection[str] = ()) -> Iterator[ast.expr]:
        """Yield the expressions that an expression may be; a local name stands for what is assigned to it."""
        parts: Iterable[ast.expr] = ()
        match node:
            case ast.IfExp(body=body, orelse=orelse):
                parts = [body, orelse]
            case ast.NamedExpr(value=value):
                parts = [value]
            case ast.BoolOp(values=parts) | ast.Tuple(elts=parts) | ast.List(elts=parts):
                pass
            case ast.Call(args=args):
                yield node
                parts = () if _called(node) in RECORDS | MAKERS else args  # theirs are found by themselves
            case ast.Name(id=name) if name not in seen:
                parts, seen = self._assigned.get((id(self._inner[id(node)]), name), ()), [*seen, name]
            case _:
                yield node
        for part in parts:
            yield from self._leaves(part, seen)

    def _wordings(self, node: ast.expr) -> list[str]:
        """Return the texts that an expression may be."""
        return [text for leaf in self._leaves(node) for text in self._texts_of(leaf)]

    def _texts_of(self, leaf: ast.expr) -> list[str]:
        match leaf:
            case ast.Constant(value=str(text)):
                return [text]
            case ast.JoinedStr(values=parts):
                return ["".join(_part(part) for part in parts)]
            case ast.BinOp(left=left, op=ast.Add(), right=right):
                begins, ends = (self._wordings(side) or ["{}"] for side in (left, right))
                return [begin + end for begin in begins for end in ends]
        return []


def _called(node: ast.AST) -> str:
    """Return the name of the function or attribute that an expression asks, empty if it is none."""
    match node:
        case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name)) | ast.Attribute(attr=name):
            return name
    return ""


def _is_code(node: ast.AST) -> bool:
    """Whether an expression is a constant such as `link_down`."""
    match node:
        case ast.Constant(value=str(code)):
            return code.replace("_", "").replace("-", "").isalpha() and code.islower()
    return False


def _without_values(text: str) -> str:
    return "".join(part.rpartition("}")[2] for part in text.split("{"))


def _part(part: ast.AST) -> str:
    match part:
        case ast.Constant(value=str(text)):
            return text
        case ast.FormattedValue(value=ast.Name(id=name) | ast.Attribute(attr=name)):
            return f"{{{name}}}"
    return "{}"


if __name__ == "__main__":
    FILE.write_text(all_texts(), encoding="utf-8")
