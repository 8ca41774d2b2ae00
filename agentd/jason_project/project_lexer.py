"""The tokens of project files."""

from __future__ import annotations

import re
from dataclasses import dataclass

from agentd.language.syntax_tree.errors import SyntaxErrors, problem_at
from agentd.language.syntax_tree.source import Source

TOKEN = re.compile(
    r"""(?P<blank>[ \t\r\n\f\ufeff]+|//[^\n]*|/\*.*?\*/)
      | (?P<string>"(?:[^"\\\n]|\\.)*")
      | (?P<number>\d+(?:\.\d+)?(?![\w.$/\\]))
      | (?P<word>(?:[\w$~.-]|/(?![/*])|\\)+)
      | (?P<mark>[{}()\[\]:;,=\#])""",
    re.VERBOSE | re.DOTALL,
)

END = "end"


@dataclass(frozen=True, slots=True)
class Token:
    """``kind`` is string, number, word, mark or end; the text of a string is without quotes."""

    kind: str
    text: str
    at: int
    """Its offset in the source."""

    def __str__(self) -> str:
        if self.kind == END:
            return "the end of the file"
        return f'the text "{self.text}"' if self.kind == "string" else f"'{self.text}'"


def tokenize(source: Source) -> list[Token]:
    """The tokens of a source, the last one is its end. Raises `SyntaxErrors` for what is no token."""
    found: list[Token] = []
    text, at, end = source.text, 0, 0
    while at < len(text):
        match = TOKEN.match(text, at)
        if match is None:
            raise SyntaxErrors([problem_at(source, at, _complaint(text, at))])
        kind = str(match.lastgroup)
        if kind == "string":
            found.append(Token(kind, re.sub(r"\\([\"\\])", r"\1", match.group()[1:-1]), at))
        elif kind != "blank":
            found.append(Token(kind, match.group(), at))
        at = match.end()
        if kind != "blank":
            end = at
    found.append(Token(END, "", end))
    return found


def _complaint(text: str, at: int) -> str:
    if text.startswith('"', at):
        return "this text has no closing quote on its line"
    if text.startswith("/*", at):
        return "this comment is never closed by */"
    return f"'{text[at]}' means nothing in a project file"
