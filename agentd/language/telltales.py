"""Mistakes that show in a few tokens, whatever the place in the grammar; each function tells one of them, or None."""

from __future__ import annotations

import re
from collections.abc import Callable

from agentd.language import brackets, endings, foreign
from agentd.language.errors import shown
from agentd.language.lalr import machine
from agentd.language.place import BLOCKS, SIGNS, Place

_CONNECT = {"&": "a formula", "|": "a formula", "not": "a formula", "|&|": "a formula", "|||": "a formula"}
_CHANGES = frozenset(("+", "-", "++", "--", "-+", "+<", "+>"))
_COMPUTE = frozenset(("+", "-", "*", "/", "**", "div", "mod"))


def _keyword_as_name(place: Place) -> str | None:
    if place.text not in machine().tables.keywords or place.before == "else":
        return None
    if place.text == "not":
        return _not(place)
    if place.text in ("else", "elif") and place.part == "body" and place.bracket not in ("(", "["):
        return f"an {place.text} without its if; no ; stands before {place.text}"
    if place.text in BLOCKS and place.after == "(" and not place.follows_term and not _argument(place):
        return f"{place.text} stands only in the body of a plan"
    if "NAME" in place.expected:
        return f"'{place.text}' is a keyword and cannot be used as a name"
    return None


def _argument(place: Place) -> bool:
    return place.bracket in ("(", "[") or place.before in ("!", "!!", "?") or place.part in ("trigger", "belief")


def _not(place: Place) -> str | None:
    if place.before == "not":
        return "not takes one formula without another not; write not (not a)"
    if place.part == "":
        return "'not' cannot begin a belief; what is known to be false is written ~b, what is not believed not at all"
    if place.before in SIGNS and place.part == "trigger":
        return "an event is of a belief, not of 'not': -b when b goes, +~b when its opposite comes"
    if place.follows_term and place.part in ("context", "rule") and not place.bracket:
        return "an operator such as & is missing before 'not'"
    if place.before in ("!", "!!"):
        return "'not' is a keyword and cannot be used as a name"
    return None


def _block(place: Place) -> str | None:
    """What stands in place of the brackets or braces of a block."""
    fixed = machine().tables.fixed
    expected = set(place.expected)
    if expected == {fixed["("]} and place.before in ("if", "while", "for"):
        return f"the condition of {place.before} must be in round brackets"
    word = place.text_at(place.functor_before())
    if expected == {fixed["{"]} and place.before == ")" and place.text != ")" and word in BLOCKS:
        return f"the {'body' if word in ('while', 'for') else 'branch'} of {word} must be in curly brackets"
    return None


def _number_and_name(place: Place) -> str | None:
    if place.kind_before != "NUMBER" or not place.adjoins:
        return None
    if place.kind in ("NAME", "VARIABLE", "INTERNAL"):
        written = shown(place.before + place.text)
        if place.before == "0" and place.text[0] in "xX":
            return f"there are no hexadecimal numbers: {written}"
        if re.fullmatch(r"[\d_]+", written):
            return f"a number is written without _: {shown(written.replace('_', ''))}"
        if place.text in ("e", "E"):
            return f"an exponent needs a number: {shown(place.before)}e3"
        return f"a name cannot begin with a digit: {written}"
    if place.kind == "_END" and not place.ends_line:
        return f"a number does not end with a dot; write {shown(place.before)} or {shown(place.before)}.0"
    return None


def _digit_for_name(place: Place) -> str | None:
    starts = place.tokens.starts
    if place.kind != "NUMBER" or "NAME" not in place.expected or "NUMBER" in place.expected or not place.after:
        return None
    if starts[place.index + 1] == starts[place.index] + len(place.text) and place.after[0].isalpha():
        return f"a name cannot begin with a digit: {shown(place.text + place.after)}"
    return None


def _rule_arrow(place: Place) -> str | None:
    if place.text != ":-":
        return None
    if place.part == "body":
        return "a rule stands in a plan body only in braces: +{ head :- body }"
    if place.part == "":
        return "a rule needs a head before :-"
    if place.part == "rule":
        return "a second :-; is a '.' missing before this rule?"
    return "a plan body is introduced by <- and not by :-"


def _variable_with_arguments(place: Place) -> str | None:
    if place.text == "(" and place.kind_before == "VARIABLE":
        name = shown(place.before)
        if place.before.lower() in machine().tables.keywords:
            return f"a keyword is written with small letters: {name.lower()}"
        return f"a variable cannot be followed by arguments; the name {name} must begin with a small letter"
    return None


def only_scope(place: Place) -> bool:
    """Whether the variable before can only be the namespace of something."""
    return list(place.expected) == [machine().tables.fixed["::"]]


def variable_alone(place: Place) -> str:
    """What to say of a variable that stands where only a namespace could."""
    if place.text == "(":
        return f"a belief's name begins with a small letter: {shown(place.before[:1].lower() + place.before[1:])}(...)"
    operator = place.text_at(place.index - 2)
    if operator == "@":
        return "a plan label must be an atom; it begins with a small letter"
    if operator in ("!", "?"):
        return "a variable cannot be an initial goal; a name begins with a small letter"
    return "a variable cannot be a belief; a name begins with a small letter"


def _internal_action(place: Place) -> str | None:
    if place.kind == "INTERNAL":
        name = shown(place.text)
        if place.before == "~":
            return f"the internal action {name} cannot be strongly negated; write not {name}"
        if place.before in ("!", "!!", "?", "+", "-", "+<", "+>"):
            return f"{place.before} cannot be applied to an internal action; write {name} without it"
    index = place.functor_before()
    if place.text == "[" and index >= 0 and place.tokens.types[index] == "INTERNAL":
        return "an internal action cannot have annotations"
    return None


def _sign_behind(place: Place) -> str | None:
    """``start!``: the sign of a goal behind its name."""
    if place.text not in ("!", "?") or not place.adjoins or place.kind_before != "NAME":
        return None
    if place.part in ("belief", "trigger") and place.after in (".", "<-", ":"):
        plus = "+" if place.part == "trigger" else ""
        return f"{place.text} stands before the name of a goal: {plus}{place.text}{shown(place.before)}"
    return None


def _belief_with_value(place: Place) -> str | None:
    if (
        place.part == "belief"
        and not place.bracket
        and (place.kind == "RELATION" or (place.text == ":" and place.after == "="))
    ):
        name = shown(place.text_at(place.functor_before()))
        return f"a belief has no value of its own; what is believed stands in brackets: {name}(3)"
    return None


def _operand_missing(place: Place) -> str | None:
    before = place.before
    ends = place.text in ("", ".", ";", ",", ")", "]", "}", "<-", ":", ":-", "&", "|", "*", "/", "**")
    if not ends and place.kind not in ("RELATION", "DIV", "MOD", "FORK_AND", "FORK_OR"):
        return None
    if before in _CONNECT:
        return f"{_CONNECT[before]} is missing after {before}"
    if place.kind_before == "RELATION":
        return "a term is missing after the comparison"
    if before in _CHANGES and place.part == "body" and place.text_at(place.index - 2) in ("<-", ";", "{", "}"):
        return f"{before} needs a belief"
    if before in _COMPUTE and "NUMBER" in place.expected:
        return "a number or variable is missing after the operator"
    if place.text in ("&", "|") and not place.follows_term and place.bracket != "[":
        return f"a formula is missing before {place.text}"
    if place.kind == "RELATION" and not place.follows_term:
        return f"a term is missing before {place.text}"
    return None


def _label(place: Place) -> str | None:
    if place.before == "@":
        return "a plan label must be an atom, for instance @fast"
    if place.part != "label" or place.bracket:
        return None
    if place.text == "@":
        return "a plan has one label; more of it goes into annotations: @fast[atomic]"
    if not place.text or place.text in (".", ";"):
        return "a label without its plan; a plan begins with + or - or ^ after its label"
    if place.text == ":":
        return "no : stands between a label and its plan"
    if place.text not in SIGNS and place.follows_term and place.text not in ("(", "["):
        return "a label stands before the trigger of a plan: +, - or ^"
    return None


def _trigger(place: Place) -> str | None:
    if place.part == "" and place.text in ("-+", "++", "--", "+<", "+>", "*", "!!"):
        if place.text == "!!":
            return "an initial goal is written !g"
        return f"{place.found} cannot begin a plan; it begins with + (a belief or goal has come) or - (it has gone)"
    if place.part == "trigger" and not place.bracket and place.before in ("!", "?"):
        return f"{place.text_at(place.index - 2)}{place.before} needs a goal, for instance +{place.before}start"
    if place.part == "trigger" and not place.bracket and place.before in SIGNS and place.text != "!!":
        return f"{place.before} needs a belief, or a goal as in {place.before}!g"
    if place.part == "trigger" and not place.bracket and place.follows_term:
        if place.begins_plan(place.index) and not place.begins_line:
            return f"a plan has one trigger; is a '.' missing before '{place.text}{place.after}'?"
        if place.text in ("&", "|", ","):
            return "a plan has one trigger; further conditions go into the context: +!g : a <- ..."
        if place.kind in ("NAME", "INTERNAL", "VARIABLE", "LBRACE", "BANG", "QUERY", "NOT", "NUMBER", "STRING"):
            return f"{place.found} cannot stand after the trigger; a body needs <- before it, a context : before it"
    return None


def _goal_as_condition(place: Place) -> str | None:
    if place.text not in ("!", "!!") or place.part not in ("context", "rule"):
        return None
    if place.before in (":", ":-", "&", "|", "not", "(", "<:"):
        return f"a goal cannot be a condition; {place.found} stands only in bodies"
    return None


def _directive(place: Place) -> str | None:
    if place.bracket != "{" or place.part != "braces" or place.kind_before != "NAME":
        return None
    if place.kind in ("NAME", "STRING", "VARIABLE", "NUMBER", "QUOTED"):
        name = shown(place.before)
        return f"what a directive is about stands in round brackets: {name}({shown(place.text)})"
    return None


def _alone(place: Place) -> str | None:
    """What cannot begin an item, or is missing where the text ends."""
    if place.part == "" and place.text == "<-" and place.kind_before != "_END":
        return "a body needs a trigger before it: +!g <- ..."
    if place.part == "" and place.text == "." and place.before == "}":
        return "no '.' stands after }, neither of a directive nor of plans in braces"
    if place.part == "" and place.kind == "INTERNAL" and not place.text.startswith("."):
        return f"{shown(place.text)} is read as an internal action; put a blank behind a '.' that ends something"
    if place.before == "::":
        return "a name with a small letter is missing after ::"
    if place.before == "~":
        return "~ stands before a literal"
    return None


TELLTALES: tuple[Callable[[Place], str | None], ...] = (
    endings.capital_action,
    foreign.word,
    _block,
    _belief_with_value,
    foreign.operator,
    _keyword_as_name,
    _number_and_name,
    _digit_for_name,
    _variable_with_arguments,
    _internal_action,
    _goal_as_condition,
    _directive,
    _alone,
    _sign_behind,
    _label,
    endings.missing_dot,
    endings.missing_dot_before_belief_event,
    endings.after_the_dot,
    _rule_arrow,
    brackets.unclosed,
    brackets.in_brackets,
    endings.missing_semicolon,
    _operand_missing,
    _trigger,
    endings.missing_end,
)
