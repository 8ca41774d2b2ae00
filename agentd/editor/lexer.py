"""Lexers for Pygments: `pygmentize -l asl FILE.asl`, and blocks ```` ```asl ```` in documents.

The AgentSpeak lexer uses the expressions of the parser's lexer; its tokens joined are the text again.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache, lru_cache
from typing import Any, ClassVar

from pygments.lexer import Lexer
from pygments.token import Comment, Error, Keyword, Name, Number, Punctuation, String, Text, string_to_tokentype

from agentd.editor.token_classes import BLANK, DIRECTIVES, OF_SIGN, OF_TYPE, OF_WORD, Class, library_names
from agentd.jason_project.project_parser import TOKEN
from agentd.language.parser.lexer import BROKEN, Lexicon, lexicon
from agentd.language.parser.parse_tables import load

Piece = tuple[int, Any, str]


class AgentSpeakLexer(Lexer):  # type: ignore[misc]
    """AgentSpeak in Jason's dialect."""

    name = "AgentSpeak"
    url = "https://jason-lang.github.io"
    aliases: ClassVar[list[str]] = ["asl", "agentspeak"]
    filenames: ClassVar[list[str]] = ["*.asl"]
    mimetypes: ClassVar[list[str]] = ["text/x-agentspeak"]
    version_added = ""

    def get_tokens_unprocessed(self, text: str) -> Iterator[Piece]:
        """Yield the pieces of a text, all of it: where each begins, what it is, and its text."""
        for at, of, piece in classed(text):
            yield at, Text.Whitespace if of is None else Error if of == BROKEN else _type(of), piece


class ProjectLexer(Lexer):  # type: ignore[misc]
    """Project files of Jason."""

    name = "Jason project"
    url = "https://jason-lang.github.io"
    aliases: ClassVar[list[str]] = ["mas2j"]
    filenames: ClassVar[list[str]] = ["*.mas2j"]
    version_added = ""

    def get_tokens_unprocessed(self, text: str) -> Iterator[Piece]:
        """Yield the pieces of a text, all of it."""
        at = 0
        while at < len(text):
            found = TOKEN.match(text, at)
            piece = text[at] if found is None else found.group()
            yield at, Error if found is None else _of_project(str(found.lastgroup), text, found.end(), piece), piece
            at += len(piece)


def _of_project(kind: str, text: str, end: int, piece: str) -> Any:
    if kind == "blank":
        return Comment if piece.startswith("/") else Text.Whitespace
    if kind == "word":
        if piece == "MAS" or text[end:].lstrip().startswith(":"):
            return Keyword
        return Name.Variable if piece[0].isupper() else Name
    return {"string": String.Double, "number": Number}.get(kind, Punctuation)


@lru_cache(maxsize=1)
def _lexicon() -> tuple[Lexicon, frozenset[str]]:
    return lexicon(load()), frozenset(library_names())


@cache
def _type(of: Class) -> Any:
    return string_to_tokentype(of.value.pygments)


def classed(text: str) -> Iterator[tuple[int, Any, str]]:
    """Yield the pieces of a text with the `Class` of each, None for blanks, BROKEN for what is no token."""
    words, library = _lexicon()
    before, at = "", 0
    while at < len(text):
        found = words.master.match(text, at)
        kind = BROKEN if found is None else found.lastgroup or BROKEN
        piece = text[at] if found is None else found.group()
        if kind == BLANK:
            yield at, None, piece
        elif kind == BROKEN:
            yield at, BROKEN, piece
            before = ""
        else:
            yield at, _class(kind, piece, before, text[at + len(piece) : at + len(piece) + 80], library, words), piece
            if kind not in words.ignored:
                before = piece
        at += len(piece)


def _class(kind: str, piece: str, before: str, after: str, library: frozenset[str], words: Lexicon) -> Class:
    match kind:
        case "OP":
            return OF_SIGN[piece]
        case "NAME" if piece in words.keywords:
            return OF_WORD[piece]
        case "NAME" if before == "@":
            return Class.LABEL
        case "NAME" if before == "{" and piece in DIRECTIVES:
            return Class.DIRECTIVE
        case "NAME" if after.startswith("("):
            return Class.CALL
        case "INTERNAL" if piece in library:
            return Class.BUILTIN
    return OF_TYPE[kind]
