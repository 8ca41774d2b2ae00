"""Strings and the text of terms."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from agentd.language.parse import parse_term
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.language.terms.format import whole_text
from agentd.language.terms.from_ast import instantiate
from agentd.language.terms.numbers import java_int
from agentd.language.terms.terms import (
    EMPTY,
    Collection,
    List,
    Literal,
    Term,
    Var,
    atom,
    deref,
    make_list,
    proper,
    split,
)
from agentd.mind.beliefs.term_copy import resolve
from agentd.mind.beliefs.unification import Trail, undo, unify
from agentd.mind.beliefs.work_limit import MOST_MEMBERS, PARSING, bounded, joined, work
from agentd.mind.data.formula_failure import Failed, argument, wrong_arguments
from agentd.mind.data.registry import function, internal_action
from agentd.mind.state import MindState
from agentd.stdlib.java_regex import replace_all


def plain_text(term: Term) -> str:
    """The text of a term without the quotes of a string or quoted atom. Raises as `whole_text`."""
    term = deref(term)
    if type(term) is str:
        return term
    written = whole_text(resolve(term))
    if type(term) is Literal and not term.args and written.startswith("'") and written.endswith("'"):
        return written[1:-1]
    return written


@internal_action(".concat", (2, None), pure=True)
def concat(mind: MindState, trail: Trail, *args: Any) -> bool:
    """``.concat(T, ..., R)``: joins lists, or the texts of all terms.

    ?- .concat([a], [b,c], R) gives R = [a,b,c]
    ?- .concat("up at ", 5, " m", R) gives R = "up at 5 m"
    """
    *parts, result = args
    result = deref(result)
    if type(deref(parts[0])) is List:
        together: list[Any] = []
        for part in parts:
            members = proper(part)
            if members is None:
                wrong_arguments(".concat joins lists with lists only")
            together.extend(members)
            bounded(".concat", len(together), MOST_MEMBERS, "members")
        if type(result) is not List and type(result) is not Var:
            raise Failed("internal_action", "the last argument of .concat is neither a list nor a variable")
        return unify(result, make_list(together), trail)
    whole = joined(".concat", map(plain_text, parts))
    if type(result) is Literal:
        return plain_text(result) == whole
    return unify(result, whole, trail)


def length_of(term: Term) -> float | None:
    """Return the number of members or characters; None for a term that has none."""
    term = deref(term)
    if type(term) is List:
        if term is not EMPTY and term.tail is EMPTY:
            return float(len(term.items) - term.at)
        return float(len(split(term)[0]))
    if type(term) is str:
        return float(len(term))
    return float(len(term.content)) if type(term) is Collection else None


@internal_action(".length", 2, pure=True)
def length(mind: MindState, trail: Trail, term: Term, result: Term) -> bool:
    """``.length(ListOrString, N)``: how many members, or characters.

    ?- .length([a,b], N) gives N = 2
    """
    number = length_of(term)
    return number is not None and unify(result, number, trail)


@function(".length", 1, pure=True)
def length_function(mind: MindState, term: Term) -> Any:
    """``.length(ListOrString)`` as a value: how many members, or characters.

    ?- N = .length([a,b]) + 1 gives N = 3
    """
    return length_of(term)


@internal_action(".substring", (2, 4), backtracks=True, pure=True)
def substring(mind: MindState, trail: Trail, *args: Any) -> Iterator[None]:
    """``.substring(S, T)``, ``.substring(S, T, From[, To])``: S occurs in T; each place where it does.

    Of a text S and a free variable T, T is the part from From to before To.

    ?- .substring("d", "abcd") holds
    ?- .substring("b", "abab", At) gives At = 1; At = 3
    ?- .substring("waypoint", T, 3) gives T = "point"
    """
    if len(args) == 2:
        if plain_text(args[0]) in plain_text(args[1]):
            yield None
        return
    first, second = deref(args[0]), deref(args[1])
    cut = type(first) is Var or type(second) is Var
    mark = len(trail)
    if cut:
        source, result = (second, first) if type(first) is Var else (first, second)
        whole = plain_text(source)
        start, end = _position(args[2]), _position(args[3]) if len(args) == 4 else len(whole)
        if not 0 <= start <= end <= len(whole):
            raise Failed("unknown", "positions outside of the string in .substring")
        if unify(result, whole[start:end], trail):
            yield None
        undo(trail, mark)
        return
    part, whole = plain_text(first), plain_text(second)
    at = whole.find(part)
    while at >= 0:
        if unify(args[2], float(at), trail) and (len(args) == 3 or unify(args[3], float(at + len(part) - 1), trail)):
            yield None
        undo(trail, mark)
        at = whole.find(part, at + 1)


def _position(term: Term) -> int:
    return java_int(argument(float, term, "a position in a string is a number", "unknown"))


@internal_action(".replace", 4, pure=True)
def replace(mind: MindState, trail: Trail, term: Term, pattern: Term, new: Term, result: Term) -> bool:
    """``.replace(T, Regex, New, R)``: all matches; ``$1`` in New is a group.

    ?- .replace("a1b22", "([0-9]+)", "<$1>", R) gives R = "a<1>b<22>"
    """
    needed = ".replace takes a pattern and a text as strings"
    expression, inserted = argument(str, pattern, needed, "unknown"), argument(str, new, needed, "unknown")
    return unify(result, replace_all(expression, inserted, plain_text(term)), trail)


def _in_case(name: str, change: Callable[[str], str], what: str, example: str) -> None:
    @internal_action(name, 2, pure=True)
    def in_case(mind: MindState, trail: Trail, term: Term, result: Term) -> bool:
        return unify(result, joined(name, [change(plain_text(term))]), trail)  # a capital may be three characters

    in_case.__doc__ = f"``{name}(S, R)``: {what}.\n\n?- {name}({example}"


_in_case(".lower_case", str.lower, "in small letters", '"GUIDED", R) gives R = "guided"')
_in_case(".upper_case", str.upper, "in capitals", '"rtl", R) gives R = "RTL"')


@internal_action(".reverse", 2, pure=True)
def reverse(mind: MindState, trail: Trail, term: Term, result: Term) -> bool:
    """``.reverse(ListOrString, R)``: from the last to the first.

    ?- .reverse([a,b], R) gives R = [b,a]
    """
    term, target = deref(term), deref(result)
    if type(term) is str:
        if type(target) is not str and type(target) is not Var:
            wrong_arguments("the result of .reverse of a string is a string")
        return unify(target, term[::-1], trail)
    members = proper(term)
    if members is None or (type(target) is not List and type(target) is not Var):
        wrong_arguments(".reverse takes a list or a string")
    return unify(target, make_list(reversed(members)), trail)


def read_term(mind: MindState, written: str) -> Any:
    """Parse a term; its variables are those of the running plan. Text that cannot be parsed becomes an atom."""
    work(mind, PARSING * len(written))
    try:
        node = parse_term(written)
    except (SyntaxErrors, RecursionError):
        return atom(written)
    values: dict[str, Any] = {}
    if mind.current is not None and mind.current.stack:
        frame = mind.current.stack[-1]
        for name, place in frame[1].slots.items():
            if place < len(frame):
                if frame[place] is None:
                    frame[place] = Var(name, len(mind.current.stack))
                values[name] = frame[place]
    return instantiate(node, values)


@internal_action(".term2string", 2, pure=True)
def term2string(mind: MindState, trail: Trail, term: Term, string: Term) -> bool:
    """``.term2string(T, S)``, either way; with both bound it compares the texts.

    ?- .term2string(at(3,4), S) gives S = "at(3,4)"
    ?- .term2string(T, "at(3,4)") gives T = at(3,4)
    """
    term, string = deref(term), deref(string)
    if type(string) is Var:
        return unify(string, whole_text(resolve(term)), trail)
    if type(string) is not str and type(term) is Var:
        string = plain_text(string)
    if type(string) is not str:
        raise Failed("internal_action", "the second argument of .term2string is a string")
    if type(term) is Var:
        return unify(term, read_term(mind, string), trail)
    return whole_text(resolve(term)) == string


@internal_action(".empty", 1, pure=True)
def empty(mind: MindState, trail: Trail, term: Term) -> bool:
    """``.empty(ListOrString)``: it has nothing in it.

    ?- .empty([]) holds
    """
    return length_of(term) == 0.0
