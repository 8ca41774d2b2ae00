"""Characters and signs that are none of the language's, and how reading goes on behind them.

The aim is that one mistake is one problem: a string in typographic quotes is read as the string it was meant to be, and
what was meant as a comment is skipped as one.
"""

from __future__ import annotations

import re
import unicodedata
from typing import Final

from agentd.language.errors.error_context import sign_at
from agentd.language.parser.lexer import BROKEN, Broken
from agentd.language.syntax_tree.errors import SYNTAX, Problem, problem_at, shown
from agentd.language.syntax_tree.source import Source
from schemas.files.findings import Finding

_ESCAPES: Final = "ntbrf01234567\"'\\"
"""The characters that may follow a backslash in a string."""

_COMPARISONS: Final = {
    "less or equal is written <=": ("=<", "<=="),
    "greater or equal is written >=": ("=>", ">=="),
    "equality is written ==": ("===", "=:="),
    "inequality is written \\==": ("!=", "!==", "=\\=", "\\=", "\\=@=", "<>", "~=", "/="),
}
"""Comparisons, with how other languages write them."""

_SIGNS: Final = {
    "&&": "'and' is written &",
    "||": "'or' is written |",
    "\\+": "a negation is written not",
    "*/": "this */ closes no comment; a comment within another one ends at the first */",
    ":=": "a variable gets its value by = and not by :=",
}
"""Other signs, with what to write."""

COUNTING: Final = frozenset(("+=", "-=", "*=", "++", "--"))
"""Signs of other languages that change a variable."""

_HINTS: Final = {
    "the arrow before a body is written <-": "\u2190\u2192\u21d0\u21d2",
    "less or equal is written <=": "\u2264",
    "greater or equal is written >=": "\u2265",
    "inequality is written \\==": "\u2260",
    "'and' is written &": "\u2227",
    "'or' is written |": "\u2228",
    "'not' is written not": "\u00ac",
    "a product is written with *": "\u00d7",
    "a quotient is written with /": "\u00f7",
    "a minus is the sign - of the keyboard": "\u2013\u2014\u2212",
    "write what it stands for, or remove it": "\u2026",
    "a variable begins with a capital letter: X": "$",
}
"""What to write for characters of other languages and of word processors."""

_QUOTES: Final = dict.fromkeys("\u201c\u201d\u201e\u00ab\u00bb", '"') | dict.fromkeys("\u2018\u2019\u00b4`", "'")
"""Typographic quotes, with the straight ones."""


def broken(source: Source, at: int) -> Broken:
    """Return what is wrong at offset ``at``, an index of the text, where no token begins."""
    text = source.text
    character = text[at]
    if character == '"':
        return _bad_string(source, at)
    if text.startswith("/*", at):
        message = "the comment that begins here is not closed; put */ at its end"
        return Broken(problem_at(source, at, message), len(text))
    if character == "'":
        message = "the quoted name that begins here is not closed before the end of its line; put ' there"
        return Broken(problem_at(source, at, message), _line_end(text, at))
    if character in "#%":
        return _comment(source, at)
    if character in _QUOTES:
        return _typographic(source, at)
    if character.isalpha():
        return _letters(source, at)
    return _character(source, at)


def _bad_string(source: Source, at: int) -> Broken:
    text = source.text
    index = at + 1
    bad: int | None = None
    while index < len(text) and text[index] not in '"\n':
        if text[index] == "\\" and index + 1 < len(text) and text[index + 1] != "\n":
            if bad is None and text[index + 1] not in _ESCAPES:
                bad = index
            index += 1
        index += 1
    index = min(index, len(text))
    if bad is not None and text[index : index + 1] == '"':
        what = text[bad : bad + 2]
        message = f'{what} is not an escape of a string; there are \\n and \\", a backslash itself is written \\\\'
        return Broken(problem_at(source, bad, message), index + 1, "STRING")
    line, column = source.place(at)
    message = f"the string that begins in column {column} of line {line} is not closed in its line; "
    typographic = next((c for c in text[at:index] if _QUOTES.get(c) == '"'), None)
    message += f'{typographic} does not close it, only " does' if typographic else 'end it with "'
    # Jason reports it where the next line begins; the excerpt shows the string.
    place = (line + 1, 1) if index < len(text) else (line, column)
    problem = Problem(Finding(source.file, *place, message, kind=SYNTAX), source.line(line), column)
    end = _end_in_later_line(text, index)
    return Broken(problem, end or index, "STRING" if end else BROKEN)


def _end_in_later_line(text: str, line_end: int) -> int | None:
    """Return the end of a string that was written over several lines; None if it is probably not one."""
    begin = text.rfind("\n", 0, line_end) + 1
    for _ in range(20):
        if text[begin:line_end].rstrip()[-1:] in ("", ".", ";", ")", "}"):
            return None
        begin = line_end + 1
        line_end = _line_end(text, begin)
        quotes = text.count('"', begin, line_end)
        if quotes:
            return text.find('"', begin) + 1 if quotes % 2 else None
    return None


def _line_end(text: str, at: int) -> int:
    end = text.find("\n", at)
    return len(text) if end < 0 else end


def _comment(source: Source, at: int) -> Broken:
    """``# ...`` and ``% ...``: comments of other languages, or signs of theirs."""
    text = source.text
    sign = text[at]
    end = _line_end(text, at)
    before = text[text.rfind("\n", 0, at) + 1 : at].strip()
    if re.match(r"#\s*include\b", text[at:end]):
        message = 'a file is included by { include("file.asl") }'
        return Broken(problem_at(source, at, message), end, "")
    if not before or before[-1] in ".;,{}":
        return Broken(problem_at(source, at, f"a comment begins with // and not with {sign}"), end, "")
    if sign == "%":
        message = "a remainder is written X mod Y, and a comment begins with //, not with %"
    else:
        message = "'#' is not a character of the language; a comment begins with //"
    return Broken(problem_at(source, at, message), at + 1)


def _typographic(source: Source, at: int) -> Broken:
    """Return a text in quotes that a word processor has made."""
    text = source.text
    quote = text[at]
    straight = _QUOTES[quote]
    closing = [c for c in _QUOTES if _QUOTES[c] == straight]
    ends = [found for c in (*closing, straight) if (found := text.find(c, at + 1, _line_end(text, at))) > 0]
    if not ends:
        message = f'{quote} is not a quote of the language; a string is written in straight quotes: "text"'
        return Broken(problem_at(source, at, message), at + 1)
    end = min(ends)
    inside = text[at + 1 : end]
    message = f'{quote} is not a quote of the language; a string is written in straight quotes: "{shown(inside)}"'
    readable = not re.search(r"[\"\\]", inside) if straight == '"' else bool(inside)
    return Broken(
        problem_at(source, at, message), end + 1, ("STRING" if straight == '"' else "QUOTED") * readable or BROKEN
    )


def _letters(source: Source, at: int) -> Broken:
    """Return a name with letters that are none of the language's."""
    text = source.text
    begin = end = at
    while begin and (text[begin - 1].isalnum() or text[begin - 1] == "_"):
        begin -= 1
    while end < len(text) and (text[end].isalnum() or text[end] == "_"):
        end += 1
    word = shown(text[begin:end])
    message = f"{text[at]!r} is not a letter of the language, which has a-z and A-Z; "
    message += f"a name with others is written in single quotes: '{word}'"
    if begin < at:
        return Broken(problem_at(source, at, message), end, "")
    return Broken(problem_at(source, at, message), end, "VARIABLE" if text[at].isupper() else "NAME")


def _character(source: Source, at: int) -> Broken:
    text = source.text
    character = text[at]
    foreign = foreign_sign(sign_at(text, at))
    if foreign:
        return Broken(problem_at(source, at, foreign), at + 1)
    if character == "\\":
        return Broken(problem_at(source, at, "\\ is allowed only in strings and in \\== (not equal)"), at + 1)
    if character.isspace() or unicodedata.category(character) in ("Cf", "Zs", "Cc"):
        name = unicodedata.name(character, "a control character").lower()
        message = f"an invisible character: U+{ord(character):04X}, {name}; delete it"
        return Broken(problem_at(source, at, message), at + 1, "")
    hint = next(
        (hint for hint, characters in _HINTS.items() if character in characters),
        "remove it, or write the text in double quotes",
    )
    return Broken(problem_at(source, at, f"{character!r} is not a character of the language; {hint}"), at + 1)


def foreign_sign(sign: str) -> str | None:
    """Return what to write instead of a sign of another language, None if it is none."""
    for ours, theirs in _COMPARISONS.items():
        if sign in theirs:
            return f"{ours} and not {sign}"
    if sign in COUNTING:
        return f"there is no {sign}: a variable keeps its value in a plan; write Y = X {sign[0]} 1 with a new one"
    return _SIGNS.get(sign)
