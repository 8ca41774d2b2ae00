"""What goes wrong with brackets and between them: one that is not closed, a comma too many or too few."""

from __future__ import annotations

from agentd.language.errors import shown
from agentd.language.place import BEGIN_TERM, BLOCKS, CLOSERS, END_TERM, Place

_ENDS_FORMULA = frozenset((";", ".", "<-", ":-", ":", "<:", "|&|", "|||", ""))

NO_CHOICE = "there is no c ? a : b; write if (c) { X = a } else { X = b } before it"


def unclosed(place: Place) -> str | None:
    """Something that ends a formula or a plan comes while a bracket is open, or a bracket closes another."""
    text = place.text
    closes = text in (")", "]", "}")
    if text == CLOSERS.get(place.before):
        return None
    if place.opened is None:
        return f"a {text} that nothing opens" if closes else None
    closer = CLOSERS[place.bracket]
    if text == closer:
        return None
    if place.bracket == "{":
        return _unclosed_brace(place) if closes or text in (".", "") or _begins_plan(place) else None
    condition = text == "{" and place.text_at(place.opened - 1) in BLOCKS
    plan = _begins_plan(place) or (text in ("!", "?") and place.before in ("+", "-") and _ended(place))
    if not (closes or condition or plan or text in _ENDS_FORMULA):
        return None
    if text == "." and place.kind_before == "STRING" and place.after.startswith('"'):
        return "strings are joined with .concat, and printed in a row with commas: .print(A, B)"
    if text == ";" and place.part in ("context", "rule"):
        return f"the formulas of a {place.part} are joined by & (and) or |, not by a ;"
    end = _trigger_signs(place) if plan else place.found
    return f"the {place.bracket_place()} is not closed before {end}; expected '{closer}'"


def _begins_plan(place: Place) -> bool:
    """Whether the token is one of the signs of a trigger, as in ``+!g``, at the beginning of a line."""
    first = place.index if place.begins_line else place.index - 1
    return place.text != "@" and place.begins_plan(first) and first in place.tokens.first_in_line


def _trigger_signs(place: Place) -> str:
    return f"'{place.text}{place.after}'" if place.begins_line else f"'{place.before}{place.text}'"


def _ended(place: Place) -> bool:
    """Whether a term ends before the sign before the token."""
    return place.index > 1 and place.tokens.types[place.index - 2] in END_TERM


def _unclosed_brace(place: Place) -> str | None:
    assert place.opened is not None
    if place.text == "." and _closed_later(place):
        if place.part == "braces" and place.opened and place.tokens.types[place.opened - 1] == "_END":
            return None  # sub-plans
        if place.begins_plan(place.opened + 1):
            return "a plan in braces takes no '.' at its end"
        return "no '.' stands in a block; its formulas are separated by ;"
    end = _trigger_signs(place) if _begins_plan(place) else place.found
    return f"the {place.bracket_place()} is not closed before {end}; expected '}}'"


def _closed_later(place: Place) -> bool:
    """Whether the innermost brace is closed before another plan begins."""
    depth = 1
    texts = place.tokens.texts
    for index in range(place.index + 1, len(texts)):
        depth += (texts[index] == "{") - (texts[index] == "}")
        if not depth:
            return True
        if place.begins_plan(index) and index in place.tokens.first_in_line:
            return False
    return False


def in_brackets(place: Place) -> str | None:
    """Commas and other signs between the things in a bracket."""
    if place.bracket not in ("(", "["):
        return None
    assert place.opened is not None
    before = place.tokens.types[place.opened - 1] if place.opened else ""
    if place.bracket == "[":
        return _among(place, "element", "the elements of a list")
    if before in ("NAME", "QUOTED", "INTERNAL"):
        return _among(place, "argument", "arguments")
    return _in_condition(place, place.text_at(place.opened - 1))


def _among(place: Place, one: str, all_of_them: str) -> str | None:
    if place.text in (",", "|", CLOSERS[place.bracket]):
        if place.before == ",":
            return "two commas in a row" if place.text == "," else f"an {one} is missing after the comma"
        if place.before in CLOSERS and place.text == ",":
            return f"an {one} is missing before the comma"
    if place.before == "|" and place.text == "]":
        return "the tail of a list is missing after |"
    if place.follows_term and place.kind in BEGIN_TERM:
        if place.begins_line:
            return f"a comma is missing before {place.found}, or a '{CLOSERS[place.bracket]}': {_still_open(place)}"
        if place.text == "(" and place.kind_before not in ("RPAR", "RSQB"):
            return None
        if place.kind_before == "NUMBER" and place.kind == "NUMBER" and place.adjoins:
            return f"{shown(place.before + place.text)} is not a number"
        return f"{all_of_them} are separated by commas; one is missing before {place.found}"
    if place.text == ";" and place.follows_term:
        return f"{all_of_them} are separated by commas and not by ;"
    if place.text == "?" and place.follows_term:
        return NO_CHOICE
    if place.text == ":" and place.follows_term:
        return "there is no a:b; write a structure such as pair(a, b)"
    if place.kind == "RELATION" and one == "element":
        return "a comparison as an element of a list must be in brackets: [(Y > 1)]"
    return None


def _still_open(place: Place) -> str:
    return f"the {place.bracket_place()} is still open"


def _in_condition(place: Place, word: str) -> str | None:
    if place.follows_term and word == "for" and place.kind in ("NAME", "VARIABLE", "SEMICOLON"):
        return "for goes over all answers of a condition: for (.range(I, 1, 3)) { ... }"
    if place.text == "," and place.follows_term:
        if place.part == "body" and word in ("<-", ";", "{", "|&|", "|||"):
            return "body formulas are separated by ; and not by a comma"
        return "the formulas of a condition are joined by & (and) or |, not by a comma"
    if place.text == "?" and place.follows_term:
        return NO_CHOICE
    if place.follows_term and (place.kind in BEGIN_TERM or place.text == "not") and place.text != "(":
        return f"an operator such as & is missing before {place.found}"
    return None
