"""Dots and semicolons that are missing, or stand where nothing ends."""

from __future__ import annotations

from agentd.language.errors import shown
from agentd.language.place import BEGIN_TERM, BLOCKS, SIGNS, Place

_BEGIN_FORMULA = (BEGIN_TERM - {"NUMBER", "STRING", "LSQB"}) | frozenset(
    ("BANG", "BANG_BANG", "QUERY", "IF", "WHILE", "FOR", "ADD_FIRST", "ADD_LAST", "NOT", "MINUS_PLUS")
)
_NAMES = {"belief": "belief", "goal": "initial goal", "rule": "rule", "context": "plan", "trigger": "plan"}
NO_DOT = "a plan begins here, but the {} before it does not end with a '.'"


def missing_dot(place: Place) -> str | None:
    """A plan begins in a line where the plan before it has not ended."""
    if place.opened is not None or not place.index or place.kind_before == "_END":
        return None
    if place.begins_line and place.begins_plan(place.index):
        return NO_DOT.format(_NAMES.get(place.part, "plan"))
    if place.text not in ("!", "?") or place.before not in SIGNS:
        return None
    if place.index - 1 in place.tokens.first_in_line:
        return NO_DOT.format(_NAMES.get(place.part, "plan"))
    sign = place.before + place.text
    if place.part == "body":
        return f"{sign} begins a plan; is a '.' missing before it? in a body, a goal is {place.text}g"
    return None


def missing_dot_before_belief_event(place: Place) -> str | None:
    """A <- or : in a body: a plan ``+b : c <- ...`` begins in the line, or one before, and was read as ``+b``."""
    if place.part != "body" or place.opened is not None or place.text not in ("<-", ":"):
        return None
    tokens = place.tokens
    index = place.index - 1
    while index not in tokens.first_in_line and tokens.texts[index] != "<-":
        index -= 1
    if tokens.texts[index] in ("+", "-"):
        line, _ = place.source.place(tokens.starts[index])
        return f"a plan begins in line {line}, but the one before it does not end with a '.'"
    if place.text == ":":
        return "a context stands before <-; is a '.' missing before this plan?"
    return "a second <-; is a '.' missing before this plan?"


def missing_end(place: Place) -> str | None:
    """The text ends, or another belief or goal begins, where a dot could stand."""
    if place.opened is not None or "_END" not in place.expected or place.part == "":
        return None
    item = _NAMES.get(place.part, "plan")
    if place.kind == "INTERNAL" and place.adjoins and place.text.startswith("."):
        return f"a blank is missing after the '.' that ends the {item}: {shown(place.text)} is an internal action"
    if not place.text:
        return f"the last {item} does not end with a '.'"
    begins = place.kind in BEGIN_TERM or place.text in ("!", "?", "{", "@") or place.text in SIGNS
    if place.part == "belief" and place.text in ("&", "|", ",", ";"):
        return f"beliefs are not joined by {place.text}; each ends with a '.'"
    if place.part in ("belief", "goal") and begins and place.text != "(":
        return f"the {item} before {place.found} does not end with a '.'"
    if place.part == "goal" and place.text in (",", ";", "&"):
        return "each initial goal ends with a '.': !a. !b."
    begins = place.begins_line and (place.kind == "NAME" or place.text in ("!", "@", "{"))
    if place.part in ("rule", "context", "trigger") and begins:
        return f"the {item} before {place.found} does not end with a '.'"
    return None


def missing_semicolon(place: Place) -> str | None:
    """A formula begins right behind one that is complete, in a body."""
    if place.part != "body" or place.bracket in ("(", "["):
        return None
    if place.text in ("!", "!!", "?") and place.before in ("&", "|"):
        return f"goals are not joined by {place.before}; the formulas of a body are separated by ;"
    if not place.follows_term or place.text_at(place.functor_before()) in BLOCKS:
        return None
    if place.kind in _BEGIN_FORMULA and place.text != "(":
        return f"a ; is missing before {place.found}"
    if place.text in ("&", "|") and _goal_before(place):
        return f"goals are not joined by {place.text}; the formulas of a body are separated by ;"
    return None


def change_without_semicolon(place: Place) -> int | None:
    """The index of the sign in ``+a +b`` over two lines, which was read as a sum before it went wrong."""
    if place.part != "body" or place.opened is not None or place.text in ("<-", ":"):
        return None
    tokens, found = place.tokens, None
    for index in range(place.index - 1, 0, -1):
        text = tokens.texts[index]
        if text in (";", "<-", "}"):
            begins = tokens.texts[index + 1] in SIGNS and tokens.types[index + 2] in ("NAME", "QUOTED", "TILDE")
            return found if begins else None
        if index in tokens.first_in_line and text in ("+", "-"):
            found = index
    return None


def _goal_before(place: Place) -> bool:
    """Whether the formula before is a goal."""
    return place.text_at(place.functor_before() - 1) in ("!", "!!")


def after_the_dot(place: Place) -> str | None:
    """What could go on with a body stands behind the dot that has ended it."""
    if place.part == "" and place.kind_before == "_END":
        if place.text in ("<-", ":") and place.index:
            return f"{place.found} stands in a plan, but the '.' before it has ended that plan; take the '.' out"
        if place.text in (".", ",", ";"):
            return f"{place.found} after a '.'; take one of them out"
        if place.kind == "INTERNAL":
            return f"{place.found} cannot stand outside a plan; write ; and not '.' before it to go on with the body"
    if place.part in ("belief", "goal") and place.text == ";" and _after_plan(place):
        return f"{place.found} stands in a body, but a '.' before it has ended the plan; write ; for that '.'"
    return None


def _after_plan(place: Place) -> bool:
    """Whether the item before the one of the place is a plan with a body."""
    ended = 0
    for index in range(place.index - 1, -1, -1):
        ended += place.tokens.types[index] == "_END"
        if ended == 2:
            return False
        if ended and place.tokens.texts[index] == "<-":
            return True
    return False


def capital_action(place: Place) -> str | None:
    """``.Print(x)``: what should be an internal action is read as a dot and a variable."""
    types, starts = place.tokens.types, place.tokens.starts
    for dot in (place.index, place.index - 1, place.index - 2):
        name = place.text_at(dot + 1)
        if dot >= 0 and types[dot] == "_END" and name[:1].isupper() and starts[dot + 1] == starts[dot] + 1:
            return f"an internal action begins with a small letter: .{shown(name[0].lower() + name[1:])}"
    return None
