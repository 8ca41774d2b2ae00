"""Lists: members, positions, order, parts, sets as lists, ranges."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final

from agentd.language.terms.format import whole_text
from agentd.language.terms.numbers import java_int
from agentd.language.terms.order import is_in
from agentd.language.terms.terms import Collection, List, Term, Var, deref, make_list, proper, spans
from agentd.mind.beliefs.term_copy import resolve
from agentd.mind.beliefs.unification import Trail, alternatives, undo, unify
from agentd.mind.beliefs.work_limit import distinct, limited, ordered, work
from agentd.mind.data.formula_failure import Failed, argument, wrong_arguments
from agentd.mind.data.registry import internal_action
from agentd.mind.state import MindState
from agentd.stdlib.java_regex import replace_all

_COUNTED = 1024
"""Numbers of a `.range` whose work is counted together."""


def members_of(term: Term, what: str) -> list[Term]:
    """The elements of a list. Fails with ``wrong_arguments`` for anything else."""
    found = proper(term)
    if found is None:
        wrong_arguments(f"{what} takes a list")
    return found


@internal_action(".member", 2, backtracks=True, counts=True, pure=True)
def member(mind: MindState, trail: Trail, item: Term, collection: Term) -> Iterator[None]:
    """``.member(X, C)``: each member of a list, set or queue that unifies.

    ?- .member(X, [a,b]) gives X = a; X = b
    ?- .member(b, [a,b]) holds
    """
    collection = deref(collection)
    if type(collection) is Collection and collection.kind != "map":
        parts: Any = (list(collection.content),)
    elif type(collection) is List:
        parts = (span.items[span.at :] if span.at else span.items for span in spans(collection))
    else:
        wrong_arguments(".member takes a list, set or queue")
    mark = len(trail)
    for part in parts:
        work(mind, len(part))
        for element in part:
            if unify(item, element, trail):
                yield None
            if len(trail) > mark:
                undo(trail, mark)


@internal_action(".nth", 3, backtracks=True, pure=True)
def nth(mind: MindState, trail: Trail, position: Term, collection: Term, item: Term) -> Iterator[None]:
    """``.nth(I, ListOrString, X)``: from 0; with I free, each position whose element unifies.

    ?- .nth(1, [a,b,c], X) gives X = b
    ?- .nth(I, [a,b,a], a) gives I = 0; I = 2
    """
    position, collection = deref(position), deref(collection)
    members: Any = collection if type(collection) is str else members_of(collection, ".nth")
    mark = len(trail)
    if type(position) is Var:
        for at, element in enumerate(members):
            if unify(item, element, trail) and unify(position, float(at), trail):
                yield None
            undo(trail, mark)
        return
    at = java_int(argument(float, position, "the position for .nth is a number"))
    if not 0 <= at < len(members):
        raise Failed("internal_action", f"position {at} is out of range: there are {len(members)} elements")
    if unify(item, members[at], trail):
        yield None
    undo(trail, mark)


@internal_action(".delete", (3, 4), pure=True)
def delete(mind: MindState, trail: Trail, *args: Any) -> bool:
    """``.delete(What, ListOrString, R)``: by position (from 0), range, pattern, or the elements that unify.

    ?- .delete(a, [a,b,a], R) gives R = [b]
    ?- .delete(0, [a,b,a], R) gives R = [b,a]
    ?- .delete(1, 3, [a,b,c,d], R) gives R = [a,d]
    ?- .delete("[0-9]", "u4v1", R) gives R = "uv"
    """
    *what, collection, result = args
    first, collection = deref(what[0]), deref(collection)
    if type(first) is float:
        return _delete_positions([deref(w) for w in what], collection, result, trail)
    if len(what) > 1:
        raise Failed("internal_action", ".delete of a range takes two numbers")
    if type(first) is str:
        whole = collection if type(collection) is str else whole_text(resolve(collection))
        return unify(result, replace_all(first, "", whole), trail)
    members = _deletable(collection)
    left = []
    for element in members:
        mark = len(trail)
        if not unify(first, element, trail):
            undo(trail, mark)
            left.append(element)
    return unify(result, make_list(left), trail)


def _delete_positions(what: list[Any], collection: Any, result: Any, trail: Trail) -> bool:
    if any(type(w) is not float for w in what):
        raise Failed("internal_action", "positions for .delete are numbers")
    start = java_int(what[0])
    end = java_int(what[1]) if len(what) > 1 else start + 1
    first, after = max(start, 0), max(end, start, 0)
    if type(collection) is str:
        return unify(result, collection[:first] + collection[after:], trail)
    members = _deletable(collection)
    return unify(result, make_list(members[:first] + members[after:]), trail)


def _deletable(collection: Term) -> list[Term]:
    members = proper(collection)
    if members is None:
        raise Failed("internal_action", ".delete takes a list or string to delete from")
    return members


@internal_action(".sort", 2, pure=True)
def sort(mind: MindState, trail: Trail, items: Term, result: Term) -> bool:
    """``.sort(L, R)``: in standard order, duplicates kept.

    ?- .sort([b,3,a,1,a], R) gives R = [1,3,a,a,b]
    """
    return unify(result, make_list(ordered(members_of(items, ".sort"))), trail)


def _extreme(name: str, place: int, what: str, example: str) -> None:
    @internal_action(name, 2, pure=True)
    def extreme(mind: MindState, trail: Trail, items: Term, result: Term) -> bool:
        members = ordered(members_of(items, name))
        return bool(members) and unify(result, members[place], trail)

    extreme.__doc__ = (
        f"``{name}(L, X)``: the {what} member; fails for an empty list.\n\n?- {name}([3,1,2], X) {example}"
    )


_extreme(".min", 0, "least", "gives X = 1")
_extreme(".max", -1, "greatest", "gives X = 3")


def _chosen(members: list[Any], others: list[Any], common: bool) -> list[Any]:
    """Return the members that others in standard order have in common, or have not."""
    with limited("comparing members"):
        return [one for one in members if is_in(others, one) is common]


SET_OPERATIONS: Final[dict[str, tuple[Callable[[list[Any], list[Any]], list[Any]], str, str]]] = {
    "union": (lambda a, b: distinct(a + b), "the members of both, each once, in order", "[a,b,c]"),
    "intersection": (lambda a, b: _chosen(a, b, True), "the members that both have", "[a]"),
    "difference": (lambda a, b: _chosen(a, b, False), "the members of A that B has not", "[b]"),
}
"""What is made of two lists in standard order without duplicates, what that is, and what it is of [b,a] and [c,a]."""


def _set_operation(name: str, made: Callable[[list[Any], list[Any]], list[Any]], what: str, example: str) -> None:
    @internal_action(name, 3, pure=True)
    def operation(mind: MindState, trail: Trail, left: Term, right: Term, result: Term) -> bool:
        if type(deref(result)) not in (Var, List):
            wrong_arguments(f"the result of {name} is a list")
        members = distinct(members_of(left, name)), distinct(members_of(right, name))
        return unify(result, make_list(made(*members)), trail)

    operation.__doc__ = f"``{name}(A, B, R)``: {what}.\n\n?- {name}([b,a], [c,a], R) gives R = {example}"


for _name, _operation in SET_OPERATIONS.items():
    _set_operation(f".{_name}", *_operation)


def _parts(name: str, cuts: Callable[[int], Iterable[tuple[int, int]]], what: str, example: str) -> None:
    """Register an action that finds parts of a list or string; ``cuts`` gives their places for its length."""

    @internal_action(name, 2, backtracks=True, counts=True, pure=True)
    def parts(mind: MindState, trail: Trail, pattern: Term, whole: Term) -> Iterator[None]:
        whole, wanted = deref(whole), deref(pattern)
        members: Any = whole if type(whole) is str else members_of(whole, name)
        if type(wanted) is not Var and type(wanted) is not type(whole):
            wrong_arguments(f"both arguments of {name} are lists, or both strings")

        def found() -> Iterator[Any]:
            for start, end in cuts(len(members)):
                work(mind, end - start + 1)
                part = members[start:end]
                yield part if type(part) is str else make_list(part)

        yield from alternatives(pattern, found(), trail)

    variable = name[1].upper()
    call = f"{name}({variable}, [a,b]) gives {' '.join(f'{variable} = {part};' for part in example.split())[:-1]}"
    parts.__doc__ = f"``{name}({variable}, ListOrString)``: {what}.\n\n?- {call}"


def _everywhere(size: int) -> Iterator[tuple[int, int]]:
    for start in range(size):
        for end in range(size, start, -1):
            yield start, end
    yield 0, 0


_BEGINNING, _END = "each beginning that unifies, the longest first", "each end that unifies, the longest first"
_parts(".prefix", lambda n: ((0, end) for end in range(n, -1, -1)), _BEGINNING, "[a,b] [a] []")
_parts(".suffix", lambda n: ((start, n) for start in range(n + 1)), _END, "[a,b] [b] []")
_parts(".sublist", _everywhere, "each part that unifies", "[a,b] [a] [b] []")


@internal_action(".range", (3, 4), backtracks=True, counts=True, pure=True)
def number_range(
    mind: MindState, trail: Trail, item: Term, first: Term, last: Term, step: Term = 1.0
) -> Iterator[None]:
    """``.range(X, From, To[, Step])``: both ends included; with X bound, a test.

    ?- .range(X, 1, 5, 2) gives X = 1; X = 3; X = 5
    ?- .range(7, 1, 5) fails
    """
    bounds = [deref(first), deref(last), deref(step)]
    if any(type(b) is not float for b in bounds):
        wrong_arguments(".range takes numbers as bounds")
    start, end, pace = map(java_int, bounds)
    given = deref(item)
    if type(given) is float:
        if start <= given <= end:
            yield None
        return
    if type(given) is not Var:
        raise Failed("unknown", "what .range counts with is a variable or a number")
    if pace == 0:
        raise Failed("unknown", "a .range in steps of 0 has no end")
    mark = len(trail)
    numbers = range(start, end + (1 if pace > 0 else -1), pace)
    while numbers:
        some, numbers = numbers[:_COUNTED], numbers[_COUNTED:]
        work(mind, len(some))
        for at in some:
            if unify(given, float(at), trail):
                yield None
            undo(trail, mark)
