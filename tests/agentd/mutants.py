"""Bad and nearly good programs, each made from a seed and a number alone, so that any of them can be made again."""

import random
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final, TypeAlias

from msgspec.structs import replace

from agentd.language.errors.lexical import broken
from agentd.language.parse import parse_program
from agentd.language.parser.lexer import lexicon, tokenize
from agentd.language.parser.parse_tables import load
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.language.syntax_tree.nodes import Belief, Body, Plan, Program, Trigger, fields_of
from agentd.language.syntax_tree.printer import source_text
from agentd.language.syntax_tree.source import Source
from tests.agentd.generated_programs import FRAGMENTS, corpus

Make: TypeAlias = Callable[[random.Random], str]

_DEEPEST: Final = 3000
_LONGEST: Final = 20_000
"""How deep the deep inputs nest, and how many characters a huge token has, at most."""


def mutant(seed: int, number: int) -> str:
    """The input of this number in the series of this seed."""
    rng = random.Random(f"{seed}/{number}")
    make = rng.choices(KINDS, _WEIGHTS)[0]
    return make(rng)


def characters(rng: random.Random) -> str:
    """A program with a few characters put in, taken out, doubled or moved."""
    text = rng.choice(corpus())
    for _ in range(rng.randint(1, 5)):
        at = rng.randint(0, len(text))
        to = min(len(text), at + rng.randint(0, 12))
        piece = rng.choice((rng.choice(FRAGMENTS), chr(rng.randrange(32, 127)), "", "", text[at:to] * 2))
        text = text[:at] + piece + text[to:]
    return text


def tokens(rng: random.Random) -> str:
    """A program with a few tokens left out, doubled, exchanged, or replaced by those of another one."""
    words = list(rng.choice(_tokenized()))
    donor = rng.choice(_tokenized())
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        at = rng.randrange(len(words)) if words else 0
        match rng.randrange(5):
            case 0:
                del words[at : at + rng.randint(1, 3)]
            case 1:
                words[at:at] = words[at : at + rng.randint(1, 4)]
            case 2 if len(words) > 1:
                other = rng.randrange(len(words))
                words[at], words[other] = words[other], words[at]
            case 3:
                words[at : at + 1] = [rng.choice(donor)]
            case _:
                begin = rng.randrange(len(donor))
                words[at:at] = donor[begin : begin + rng.randint(1, 6)]
    return "".join(words)


def trees(rng: random.Random) -> str:
    """A program in which a few parts of the syntax tree have given way to parts of others."""
    program = rng.choice(_parsed())
    for _ in range(rng.randint(1, 3)):
        ways = list(_ways(program))
        if not ways:
            break
        way = rng.choice(ways)
        program = _grafted(program, way.steps, rng.choice(_parts()[way.kind]))
    return source_text(program)


def bytes_of_any_kind(rng: random.Random) -> str:
    """Random bytes, as they would be read in UTF-8 or in Latin-1."""
    return rng.randbytes(rng.randint(0, 200)).decode(*rng.choice((("utf-8", "replace"), ("latin-1", "strict"))))


def soup(rng: random.Random) -> str:
    """Tokens in any order."""
    return "".join(rng.choices(FRAGMENTS, k=rng.randint(0, 60)))


def deep(rng: random.Random) -> str:
    """Brackets, blocks or signs nested deep, sometimes left open."""
    opening, core, closing = rng.choice(_NESTS)
    depth = rng.randint(100, _DEEPEST)
    shut = depth if rng.random() < 0.7 else rng.randint(0, depth)
    before, after = rng.choice((("+!g <- ", "."), ("+!g : ", " <- a."), ("b(", ")."), ("", "")))
    return before + opening * depth + core + closing * shut + after


def huge(rng: random.Random) -> str:
    """A program with one token of very many characters, or very many tokens of one kind."""
    piece = rng.choice(_LONG)
    times = rng.randint(100, max(100, _LONGEST // len(piece)))
    text = rng.choice(corpus())
    at = rng.randint(0, len(text))
    return text[:at] + rng.choice(("", '"', "'", "/*", "//")) + piece * times + text[at:]


_NESTS = (
    ("(", "1", ")"),
    ("[", "a", "]"),
    ("f(", "X", ")"),
    ("f(\n", "X", ")\n"),
    ("{", "a", "}"),
    ("if (a) {", "b", "}"),
    ("if (a) { b } else {", "c", "}"),
    ("while (a) {", "b", "}"),
    ("{ +!g <- ", "a", "}"),
    ("not (", "a", ")"),
    ("-", "1", ""),
    ("a[", "b", "]"),
    ("[a|", "T", "]"),
    ("a & (", "b", ")"),
    ("X = (", "1", ")"),
    (". { +!g <- a", "", "}"),
    ("{ begin namespace(n) }", "b.", "{ end }"),
    ("a; (", "b", ")"),
    ("a |&| (", "b", ")"),
    ("2 ** ", "2", ""),
)

_LONG = (
    *("a", "Z", "9", "0", ".9", "_", "é", "\\", "\\n", "\0", "*", "/", "-", "+", "!", "~", ";", ",", ".", " ", "\n"),
    *("a.b", ".a", "1e", "/*", "*/", "//\n", "'", '"', "((", "))", "[]", "{}", "a,", "a;", "a & ", "b. ", "b.\n"),
    *("+!g. ", "+!g <- a.\n", "+!g <- a\n", "1 + ", "X = 1; ", "if (a) {} ", "@l ", "n::", "<-", ":-", "|||", "not "),
)

KINDS: tuple[Make, ...] = (characters, tokens, trees, bytes_of_any_kind, soup, deep, huge)
_WEIGHTS = (40.0, 34.0, 18.0, 3.0, 4.0, 0.5, 0.5)
"""Deep and huge inputs take a hundred times as long as the others."""


@lru_cache(maxsize=1)
def _tokenized() -> tuple[tuple[str, ...], ...]:
    """The programs of the corpus as tokens, each with the blanks and comments before it."""
    lexical = lexicon(load())
    found = []
    for text in corpus():
        read = tokenize(Source(text, ""), lexical, broken)
        ends = [0, *(start + len(word) for start, word in zip(read.starts, read.texts, strict=True))]
        words = (text[end : start + len(word)] for end, start, word in zip(ends, read.starts, read.texts, strict=False))
        found.append(tuple(words))
    return tuple(words for words in found if words)


@lru_cache(maxsize=1)
def _parsed() -> tuple[Program, ...]:
    """The programs of the corpus that are none of the refused ones."""
    found = []
    for text in corpus():
        try:
            found.append(parse_program(text, "a.asl"))
        except SyntaxErrors:
            continue
    return tuple(found)


@dataclass(frozen=True, slots=True)
class _Way:
    """Where in a tree a node stands: field names and indices from the root, and what may stand there."""

    steps: tuple[str | int, ...]
    kind: str


def _ways(tree: Any, steps: tuple[str | int, ...] = ()) -> list[_Way]:
    """The ways to all nodes that others may take the place of."""
    found = []
    if names := fields_of(type(tree)):
        if steps and (kind := _kind(tree)):
            found.append(_Way(steps, kind))
        for name in names:
            if name not in ("position", "file", "warnings"):
                found += _ways(getattr(tree, name), (*steps, name))
    elif isinstance(tree, tuple):
        for index, part in enumerate(tree):
            found += _ways(part, (*steps, index))
    return found


def _kind(node: Any) -> str:
    match node:
        case Plan() | Body() | Trigger():
            return type(node).__name__
    module = type(node).__name__
    if module in ("Belief", "Rule", "Goal", "Directive", "Program"):
        return ""
    return "formula" if module in ("Step", "If", "While", "For", "Fork") else "term"


@lru_cache(maxsize=1)
def _parts() -> dict[str, list[Any]]:
    """The nodes of all programs by what they may stand for."""
    found: dict[str, list[Any]] = {}
    for program in _parsed():
        for way in _ways(program):
            node: Any = program
            for step in way.steps:
                node = getattr(node, step) if isinstance(step, str) else node[step]
            found.setdefault(way.kind, []).append(node)
    return found


def _grafted(tree: Any, steps: tuple[str | int, ...], part: Any) -> Any:
    """The tree with another part at the end of a way."""
    if not steps:
        return part
    step, rest = steps[0], steps[1:]
    if isinstance(step, str):
        grafted = _grafted(getattr(tree, step), rest, part)
        return Belief(grafted, tree.position) if isinstance(tree, Belief) else replace(tree, **{step: grafted})
    return (*tree[:step], _grafted(tree[step], rest, part), *tree[step + 1 :])
