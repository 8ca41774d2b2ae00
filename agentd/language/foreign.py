"""What other languages write, and what stands for it here: operators, words, characters."""

from __future__ import annotations

from typing import Final

from agentd.language.errors import shown
from agentd.language.place import Place
from agentd.language.spelling import near

_SIGNS: Final = frozenset("=<>!\\~/:+*&|-%^")

_COMPARISONS: Final = {
    "=<": "<=",
    "=>": ">=",
    "===": "==",
    "=:=": "==",
    ">==": ">=",
    "<==": "<=",
    "!=": "\\==",
    "!==": "\\==",
    "=\\=": "\\==",
    "\\=": "\\==",
    "\\=@=": "\\==",
    "<>": "\\==",
    "~=": "\\==",
    "/=": "\\==",
}
"""Comparisons as others write them, with ours."""

_KINDS: Final = {"<=": "less or equal", ">=": "greater or equal", "==": "equality", "\\==": "inequality"}

_ARROWS: Final = frozenset(("->", "=>", "<=", "-->", "==>", "<==", ":=", "::=", "<-:"))

COUNTING: Final = frozenset(("+=", "-=", "*=", "++", "--"))

_WORDS: Final = {
    "and": "'and' is written &",
    "or": "'or' is written |",
    "is": "there is no 'is'; = computes: X = Y + 1",
    "in": "there is no 'in'; the members of a list are found by .member(X, L)",
    "then": "there is no 'then'; what an if does stands in curly brackets: if (a) { b }",
    "return": "a plan returns nothing; a result is an argument of its goal: +!double(X, Y) <- Y = X * 2",
    "exists": "there is no 'exists'; a condition holds if there is an answer to it",
    "forall": "there is no 'forall'; write not (b(X) & not c(X)) in a condition, for (b(X)) { ... } in a body",
    "let": "a variable needs no 'let': X = 1",
    "var": "a variable needs no 'var': X = 1",
}

_INSTEAD_OF_BLOCKS: Final = {
    "elseif": "a further condition is written elif (...) { ... }",
    "elsif": "a further condition is written elif (...) { ... }",
    "foreach": "a loop over all answers is written for (...) { ... }",
    "forall": "a loop over all answers is written for (...) { ... }",
    "until": "there is no until; write while (not (...)) { ... }",
    "unless": "there is no unless; write if (not (...)) { ... }",
    "switch": "there is no switch; write if (...) { ... } elif (...) { ... }",
    "do": "there is no do; write while (...) { ... }",
    "repeat": "there is no repeat; write while (...) { ... }",
    "try": "there is no try; what to do when +!g fails stands in a plan -!g",
    "catch": "there is no catch; what to do when +!g fails stands in a plan -!g",
}


def operator(place: Place) -> str | None:
    """An operator that other languages have."""
    if place.part == "" and place.text in ("/", "--"):
        return "a comment begins with //"
    sign = sign_at(place.source.text, place.tokens.starts[place.index])
    if sign in ("&&", "||") and place.part == "body" and not place.bracket:
        return f"the formulas of a body are separated by ; and not by {sign}"
    if sign in _ARROWS and not place.bracket and (place.part == "trigger" or place.before == ":"):
        return f"a body is introduced by <- and not by {sign}"
    found = foreign_sign(sign)
    if found and (sign not in COUNTING or place.part == "body"):
        return found
    if place.before in ("++", "--") and _after_term(place):
        return foreign_sign(place.before)
    if place.text == "^" and (place.follows_term or place.bracket):
        return "a power is written with **: X ** 2"
    if sign == "->":
        return "there is no ->; a body is introduced by <-, arguments are separated by commas"
    return None


def _after_term(place: Place) -> bool:
    """Whether the sign before the token stands behind a variable: ``X++``."""
    return place.index > 1 and place.tokens.types[place.index - 2] == "VARIABLE"


def sign_at(text: str, at: int) -> str:
    """All signs in a row around an offset."""
    begin = end = at
    while begin and text[begin - 1] in _SIGNS and at - begin < 4:
        begin -= 1
    while end < len(text) and text[end] in _SIGNS and end - at < 4:
        end += 1
    return text[begin:end]


def foreign_sign(sign: str) -> str | None:
    """What to write instead of a sign of another language, None if it is none."""
    ours = _COMPARISONS.get(sign)
    if ours:
        return f"{_KINDS[ours]} is written {ours} and not {sign}"
    if sign in ("&&", "||"):
        return _WORDS["and" if sign == "&&" else "or"]
    if sign == "\\+":
        return "a negation is written not"
    if sign == "*/":
        return "this */ closes no comment; a comment within another one ends at the first */"
    if sign == ":=":
        return "a variable gets its value by = and not by :="
    if sign in COUNTING:
        return f"there is no {sign}: a variable keeps its value in a plan; write Y = X {sign[0]} 1 with a new one"
    return None


def word(place: Place) -> str | None:
    """A word that other languages have: ``a and b``, ``foreach (...) {``."""
    if place.text == "{":
        return _before_block(place)
    if place.follows_term and place.kind in ("NAME", "VARIABLE"):
        told = _WORDS.get(place.text.lower() if place.text.isupper() else place.text)
        if told and place.part == "body" and not place.bracket and place.text.lower() in ("and", "or"):
            return f"the formulas of a body are separated by ;, not by '{place.text}'"
        if told:
            return told
    if place.before in ("return", "let", "var") and place.part == "body" and place.kind != "_END":
        return _WORDS[place.before]
    if place.before in ("exists", "forall") and place.part in ("context", "rule"):
        return _WORDS[place.before]
    if place.part in ("context", "rule") and place.before.lower() in ("not", "nto", "no") and place.before != "not":
        return f"'not' is written so, and not '{place.before}'"
    if place.before in ("import", "include") and place.part == "belief" and place.kind in ("NAME", "STRING", "QUOTED"):
        return 'a file is included by { include("file.asl") }'
    if place.text in ("if", "when", "where") and place.part == "trigger" and not place.bracket:
        return f"the context of a plan begins with : and not with {place.text}"
    if place.before == "for" and place.part == "body" and place.after == "in":
        return "for goes over all answers of a condition in round brackets: for (.member(X, L)) { ... }"
    return None


def _before_block(place: Place) -> str | None:
    """What stands before a brace as if a block could follow it."""
    if place.part != "body" or not place.follows_term or place.bracket in ("(", "["):
        return None
    functor = place.text_at(place.functor_before())
    if functor.lstrip(".") in ("if", "while", "for", "elif") and functor.startswith("."):
        return f"{functor.lstrip('.')} is written without a dot before it"
    told = _INSTEAD_OF_BLOCKS.get(functor.lstrip("."))
    if told:
        return told
    hint = near(functor.lower(), ("if", "elif", "else", "while", "for"))
    return f"a block in curly brackets stands after if, elif, else, while and for, not after '{shown(functor)}'{hint}"


CHARACTERS: Final = {
    "\u2190": "the arrow before a body is written <-",
    "\u2192": "the arrow before a body is written <-",
    "\u21d0": "the arrow before a body is written <-",
    "\u21d2": "the arrow before a body is written <-",
    "\u2264": "less or equal is written <=",
    "\u2265": "greater or equal is written >=",
    "\u2260": "inequality is written \\==",
    "\u2227": "'and' is written &",
    "\u2228": "'or' is written |",
    "\u00ac": "'not' is written not",
    "\u00d7": "a product is written with *",
    "\u00f7": "a quotient is written with /",
    "\u2013": "a minus is the sign - of the keyboard",
    "\u2014": "a minus is the sign - of the keyboard",
    "\u2212": "a minus is the sign - of the keyboard",
    "\u2026": "put what belongs there, or take it out",
    "`": "a string stands in double quotes",
}
"""Characters of other languages and of word processors, with what to write."""

QUOTES: Final = {
    "\u201c": '"',
    "\u201d": '"',
    "\u201e": '"',
    "\u00ab": '"',
    "\u00bb": '"',
    "\u2018": "'",
    "\u2019": "'",
    "\u00b4": "'",
}
"""Typographic quotes, with the straight ones."""
