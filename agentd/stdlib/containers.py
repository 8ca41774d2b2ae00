"""Maps, sets and queues: changed in place, and shared by every variable and belief that holds them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from agentd.language.terms.order import compare, is_in, place_in
from agentd.language.terms.terms import Collection, Term, Var, atom, deref, make_list, proper
from agentd.mind.beliefs.term_copy import resolve
from agentd.mind.beliefs.unification import Trail, alternatives, unify
from agentd.mind.beliefs.work_limit import MOST_MEMBERS, bounded, distinct, ordered
from agentd.mind.data.formula_failure import Failed, wrong_arguments
from agentd.mind.data.registry import internal_action
from agentd.mind.state import MindState
from agentd.stdlib.lists import SET_OPERATIONS


def _held(term: Term, kinds: tuple[str, ...], trail: Trail) -> Any:
    """The collection that an argument holds; a free variable becomes an empty map or set where that is needed."""
    collection = deref(term)
    if type(collection) is Var and kinds is not _QUEUE:
        made = Collection(kinds[0], {} if kinds[0] == "map" else [])
        unify(collection, made, trail)
        collection = made
    if type(collection) is not Collection or collection.kind not in kinds:
        raise Failed("unknown", f"a {kinds[0]} is needed")
    return collection


def _create(kind: str, term: Term, trail: Trail) -> bool:
    if type(deref(term)) is not Var:
        return False
    return unify(term, Collection(kind, {} if kind == "map" else []), trail)


_MAP = ("map",)
_SET = ("set",)
_QUEUE = ("queue", "priority")
_PRIORITY = atom("priority")


def _for_all_kinds(name: str, kinds: tuple[str, ...]) -> None:
    """Register the actions that maps, sets and queues have in common."""

    @internal_action(f".{name}.clear", 1)
    def clear(mind: MindState, trail: Trail, term: Term) -> bool:
        """``.map.clear(C)``, ``.set.clear(C)``, ``.queue.clear(C)``: empties it."""
        _held(term, kinds, trail).content.clear()
        return True

    @internal_action(f".{name}.copy", 2)
    def copy(mind: MindState, trail: Trail, term: Term, result: Term) -> bool:
        """``.map.copy(C, D)``, ``.set.copy(C, D)``, ``.queue.copy(C, D)``: another one of the same members.

        The outer container only: containers within it are shared.
        """
        held = _held(term, kinds, trail)
        return unify(result, Collection(held.kind, held.content.copy()), trail)

    if kinds is _MAP:
        return

    @internal_action(f".{name}.to_list", 2, pure=True)
    def to_list(mind: MindState, trail: Trail, term: Term, result: Term) -> bool:
        """``.set.to_list(C, L)``, ``.queue.to_list(C, L)``: its members in order.

        ?- .set.add_all(S, [c,a,c]) & .set.to_list(S, L) gives L = [a,c]
        """
        return unify(result, make_list(list(_held(term, kinds, trail).content)), trail)


_for_all_kinds("map", _MAP)
_for_all_kinds("set", _SET)
_for_all_kinds("queue", _QUEUE)


@internal_action(".map.create", 1)
def map_create(mind: MindState, trail: Trail, term: Term) -> bool:
    """``.map.create(M)``: an empty map; fails when M has a value. ``.map.put`` makes one by itself where M is free."""
    return _create("map", term, trail)


@internal_action(".map.put", 3)
def map_put(mind: MindState, trail: Trail, term: Term, key: Term, value: Term) -> bool:
    """``.map.put(M, Key, V)``: puts V under Key, in place of the former value.

    ?- .map.put(M, alt, 5) & .map.put(M, alt, 7) & .map.get(M, alt, A) gives A = 7
    """
    _held(term, _MAP, trail).content[resolve(key)] = resolve(value)
    return True


@internal_action(".map.get", (3, 4), pure=True)
def map_get(mind: MindState, trail: Trail, term: Term, key: Term, value: Term, default: Term | None = None) -> bool:
    """``.map.get(M, Key, V[, Default])``: the value under Key; fails if it is missing and no default is given.

    ?- .map.create(M) & .map.get(M, alt, A, 0) gives A = 0
    ?- .map.create(M) & .map.get(M, alt, A) fails
    """
    found = _held(term, _MAP, trail).content.get(resolve(key), default)
    return found is not None and unify(value, found, trail)


@internal_action(".map.remove", 3)
def map_remove(mind: MindState, trail: Trail, term: Term, key: Term, value: Term) -> bool:
    """``.map.remove(M, Key, V)``: removes Key; V is its value. Fails if Key is missing."""
    found = _held(term, _MAP, trail).content.pop(resolve(key), None)
    return found is not None and unify(value, found, trail)


@internal_action(".map.key", 2, backtracks=True, pure=True)
def map_key(mind: MindState, trail: Trail, term: Term, key: Term) -> Iterator[None]:
    """``.map.key(M, Key)``: each key.

    ?- .map.put(M, a, 1) & .map.put(M, b, 2) & .map.key(M, K) gives K = a; K = b
    """
    yield from alternatives(key, list(_held(term, _MAP, trail).content), trail)


@internal_action(".map.value", 2, backtracks=True, pure=True)
def map_value(mind: MindState, trail: Trail, term: Term, value: Term) -> Iterator[None]:
    """``.map.value(M, V)``: the value of each key."""
    yield from alternatives(value, list(_held(term, _MAP, trail).content.values()), trail)


@internal_action(".set.create", 1)
def set_create(mind: MindState, trail: Trail, term: Term) -> bool:
    """``.set.create(S)``: an empty set; fails when S has a value. The other actions make one where S is free."""
    return _create("set", term, trail)


@internal_action(".set.add", 2)
def set_add(mind: MindState, trail: Trail, term: Term, item: Term) -> bool:
    """``.set.add(S, X)``: X is in the set, once."""
    content, new = _held(term, _SET, trail).content, resolve(item)
    place = place_in(content, new)
    if place == len(content) or compare(content[place], new):
        content.insert(place, new)
    return True


def _members(term: Term) -> list[Term]:
    term = deref(term)
    if type(term) is Collection and term.kind != "map":
        return list(term.content)
    found = proper(term)
    if found is None:
        wrong_arguments("a list, set or queue is needed")
    return found


def _set_operation(name: str, operation: str, calls: str, example: str) -> None:
    """Register an action that changes a set by the members of another collection."""
    made = SET_OPERATIONS[operation][0]

    @internal_action(f".set.{name}", 2)
    def change(mind: MindState, trail: Trail, term: Term, items: Term) -> bool:
        held = _held(term, _SET, trail)
        held.content[:] = made(held.content, distinct([resolve(item) for item in _members(items)]))
        return True

    change.__doc__ = f"{calls}.\n\n?- {example}"


_UNION = (
    "``.set.add_all(S, L)``, ``.set.union(S, L)``: the members of a list, set or queue too",
    ".set.add(S, b) & .set.union(S, [c,a]) & .set.to_list(S, L) gives L = [a,b,c]",
)
_set_operation("add_all", "union", *_UNION)
_set_operation("union", "union", *_UNION)


@internal_action(".set.remove", 2)
def set_remove(mind: MindState, trail: Trail, term: Term, item: Term) -> bool:
    """``.set.remove(S, X)``: X is not in the set."""
    content, gone = _held(term, _SET, trail).content, resolve(item)
    if is_in(content, gone):
        del content[place_in(content, gone)]
    return True


for _name, _calls, _members_left in (
    ("intersection", "keeps only the members that are in L too", "[b]"),
    ("difference", "removes the members that are in L", "[a,c]"),
):
    _example = f".set.add_all(S, [a,b,c]) & .set.{_name}(S, [b,d]) & .set.to_list(S, L) gives L = {_members_left}"
    _set_operation(_name, _name, f"``.set.{_name}(S, L)``: {_calls}", _example)


@internal_action(".queue.create", (1, 2))
def queue_create(mind: MindState, trail: Trail, term: Term, kind: Term | None = None) -> bool:
    """``.queue.create(Q[, priority])``: an empty queue; with ``priority`` the least member comes first."""
    return _create("priority" if kind is not None and deref(kind) == _PRIORITY else "queue", term, trail)


def _enqueue(held: Collection, items: list[Term]) -> None:
    """Equal terms of a priority queue keep their order."""
    bounded(".queue.add_all", len(held.content) + len(items), MOST_MEMBERS, "members")
    held.content.extend(items)
    if held.kind == "priority":
        held.content[:] = ordered(held.content)


@internal_action(".queue.add", 2)
def queue_add(mind: MindState, trail: Trail, term: Term, item: Term) -> bool:
    """``.queue.add(Q, X)``: at its end, or at its place in a priority queue."""
    _enqueue(_held(term, _QUEUE, trail), [resolve(item)])
    return True


@internal_action(".queue.add_all", 2)
def queue_add_all(mind: MindState, trail: Trail, term: Term, items: Term) -> bool:
    """``.queue.add_all(Q, L)``: the members of a list, set or queue, in order.

    ?- .queue.create(Q, priority) & .queue.add_all(Q, [5,3,4]) & .queue.head(Q, X) gives X = 3
    """
    _enqueue(_held(term, _QUEUE, trail), [resolve(i) for i in _members(items)])
    return True


@internal_action(".queue.head", 2)
def queue_head(mind: MindState, trail: Trail, term: Term, item: Term) -> bool:
    """``.queue.head(Q, X)``: its first member, which stays; fails when it is empty."""
    content = _held(term, _QUEUE, trail).content
    return bool(content) and unify(item, content[0], trail)


@internal_action(".queue.remove", 2)
def queue_remove(mind: MindState, trail: Trail, term: Term, item: Term) -> bool:
    """``.queue.remove(Q, X)``: takes the first member out; fails when it is empty.

    ?- .queue.create(Q) & .queue.add_all(Q, [a,b]) & .queue.remove(Q, X) & .queue.to_list(Q, L) gives X = a, L = [b]
    """
    content = _held(term, _QUEUE, trail).content
    return bool(content) and unify(item, content.pop(0), trail)
