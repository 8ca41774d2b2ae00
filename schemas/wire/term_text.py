"""Convert wire terms to AgentSpeak text and back, for the paper's messages, INI manifests and people.

Only plain terms are read here; what needs the language's own parser (rules, plans, expressions) is kept as `Source`.
"""

from __future__ import annotations

import re
from typing import Literal

from schemas.wire.terms import (
    Atom,
    Map,
    Number,
    OpenList,
    Queue,
    Set,
    Source,
    Structure,
    Term,
    Variable,
    number,
)

MAX_DEPTH = 200
"""Terms nested deeper are refused by the reader, long before Python's own limit."""

_TOKEN = re.compile(
    r"""(?P<space>\s+)
      | (?P<number>[+-]?(?:[0-9]+(?:\.[0-9]+)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)
      | (?P<string>"(?:[^"\\]|\\.)*")
      | (?P<atom>[a-z][A-Za-z0-9_]*|'[^'\n]*')
      | (?P<variable>[A-Z_][A-Za-z0-9_]*)
      | (?P<mark>::|[~(),\[\]|{])""",
    re.VERBOSE | re.DOTALL,
)
_NOT_FINITE: dict[str, Literal["Infinity", "-Infinity", "NaN"]] = {
    "(1/0)": "Infinity",
    "(-1/0)": "-Infinity",
    "(0/0)": "NaN",
}
_AS_EXPRESSION = {value: text for text, value in _NOT_FINITE.items()}


class BadTerm(ValueError):
    """Text that is not a term; the text has the place and what was expected."""


def write(term: Term) -> str:
    """Return a term as AgentSpeak text. Maps, sets and queues, which have none, appear as structures of that name."""
    match term:
        case bool():
            return "true" if term else "false"
        case float():
            return str(int(term)) if term.is_integer() and abs(term) < 1e15 else repr(term)
        case int():
            return str(term)
        case str():
            return '"' + term.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'
        case list():
            return f"[{_several(term)}]"
        case Atom():
            return term.name
        case Number():
            return _AS_EXPRESSION[term.text]
        case Structure():
            args = f"({_several(term.args)})" if term.args else ""
            return f"{_prefix(term)}{term.functor}{args}{_annotations(term)}"
        case Variable():
            return f"{_prefix(term)}{term.name}{_annotations(term)}"
        case OpenList():
            return f"[{_several(term.items)}|{write(term.tail)}]"
        case Source():
            return term.text
        case Map():
            pairs = [Structure("pair", pair) for pair in term.entries]
            return write(Structure("map", tuple(pairs))) if pairs else "map"
        case Set() | Queue():
            return (
                write(Structure(type(term).__name__.lower(), term.items)) if term.items else type(term).__name__.lower()
            )


def _several(terms: list[Term] | tuple[Term, ...]) -> str:
    return ",".join(map(write, terms))


def _prefix(term: Structure | Variable) -> str:
    return ("~" if term.negated else "") + (f"{term.namespace}::" if term.namespace else "")


def _annotations(term: Structure | Variable) -> str:
    return f"[{_several(term.annotations)}]" if term.annotations else ""


def read(text: str) -> Term:
    """Return the term that `text` is. Raises BadTerm that says where it stops being one."""
    reader = _Reader(text)
    term = reader.term(0)
    if reader.kind != "end":
        raise reader.expected("the end of the term")
    return term


class _Reader:
    """Reads tokens one ahead."""

    def __init__(self, text: str) -> None:
        self.text, self.at, self.kind, self.token = text, 0, "", ""
        self.start = 0
        self.next()

    def next(self) -> None:
        while True:
            self.start = self.at
            if self.at >= len(self.text):
                self.kind, self.token = "end", ""
                return
            found = _TOKEN.match(self.text, self.at)
            if found is None:
                self.kind, self.token = "unknown", self.text[self.at]
                return
            self.at, self.kind, self.token = found.end(), str(found.lastgroup), found[0]
            if self.kind != "space":
                return

    def expected(self, what: str) -> BadTerm:
        got = f"`{self.token}`" if self.token else "the end"
        return BadTerm(f"expected {what} at character {self.start + 1}, got {got}: {_short(self.text)}")

    def take(self, token: str) -> None:
        if self.token != token or self.kind != "mark":
            raise self.expected(f"`{token}`")
        self.next()

    def term(self, depth: int) -> Term:
        if depth > MAX_DEPTH:
            raise BadTerm(f"nested deeper than {MAX_DEPTH}: {_short(self.text)}")
        token = self.token
        match self.kind, token:
            case "number", _:
                self.next()
                return int(token) if re.fullmatch(r"[+-]?[0-9]{1,15}", token) else number(float(token))
            case "string", _:
                self.next()
                return re.sub(r"\\(.)", lambda found: {"n": "\n"}.get(found[1], found[1]), token[1:-1], flags=re.DOTALL)
            case "mark", "[":
                return self.list_(depth)
            case "mark", "(" | "{":
                return self.source()
            case ("atom" | "variable", _) | ("mark", "~" | "::"):
                return self.literal(depth)
        raise self.expected("a term")

    def literal(self, depth: int) -> Term:
        negated = self.token == "~"
        if negated:
            self.next()
        namespace, kind, name = "", self.kind, self.token
        if kind not in ("atom", "variable"):
            raise self.expected("a name")
        self.next()
        if self.token == "::" and self.kind == "mark":
            namespace = name
            self.next()
            kind, name = self.kind, self.token
            if kind not in ("atom", "variable"):
                raise self.expected("a name after `::`")
            self.next()
        args: tuple[Term, ...] = ()
        if kind == "atom" and self.token == "(":
            self.next()
            args = self.several(depth)
            self.take(")")
        annotations: tuple[Term, ...] = ()
        if self.token == "[" and self.kind == "mark":
            self.next()
            annotations = self.several(depth)
            self.take("]")
        if kind == "variable":
            return Variable(name, annotations, negated, namespace)
        if not (args or annotations or negated or namespace):
            return {"true": True, "false": False}.get(name, Atom(name))
        return Structure(name, args, annotations, negated, namespace)

    def several(self, depth: int) -> tuple[Term, ...]:
        terms = [self.term(depth + 1)]
        while self.token == "," and self.kind == "mark":
            self.next()
            terms.append(self.term(depth + 1))
        return tuple(terms)

    def list_(self, depth: int) -> Term:
        self.take("[")
        if self.token == "]":
            self.next()
            return []
        items = self.several(depth)
        if self.token == "|":
            self.next()
            tail = self.term(depth + 1)
            self.take("]")
            return [*items, *tail] if isinstance(tail, list) else OpenList(items, tail)
        self.take("]")
        return list(items)

    def source(self) -> Term:
        """Take a balanced `(...)` or `{...}` unchanged, strings and quoted atoms in it included."""
        start, depth, at = self.start, 0, self.start
        for found in re.finditer(r"""\"(?:[^"\\]|\\.)*\"|'[^'\n]*'|[({\[\])}]""", self.text[start:], re.DOTALL):
            if found[0] in "({[":
                depth += 1
            elif found[0] in ")}]":
                depth -= 1
                if depth == 0:
                    at = start + found.end()
                    break
        else:
            raise self.expected("a closed bracket")
        text = self.text[start:at]
        self.at = at
        self.next()
        if text in _NOT_FINITE:
            return Number(_NOT_FINITE[text])
        return Source(_what(text), text)


def _what(text: str) -> Literal["plan", "rule", "trigger", "body", "expression"]:
    if text.startswith("("):
        return "expression"
    inner = text[1:-1].strip()
    if ":-" in inner:
        return "rule"
    if re.match(r"(@[^+\-^]*)?[+\-^][!?]?", inner, re.DOTALL) and re.match(r"@|[+\-^][!?]", inner):
        return "plan" if "<-" in inner or " : " in inner or inner.startswith("@") else "trigger"
    return "body"


def _short(text: str) -> str:
    return text if len(text) <= 60 else text[:57] + "..."
