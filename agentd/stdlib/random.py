"""Chance: random numbers, members and orders, all from the mind's own seeded source."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from agentd.language.numbers import java_int
from agentd.language.terms import List, Var, deref, make_list
from agentd.mind.failed import wrong_arguments
from agentd.mind.unifier import Trail, undo, unify
from agentd.stdlib.lists import members_of
from agentd.stdlib.registry import internal_action


@internal_action(".shuffle", 2)
def shuffle(mind: Any, trail: Trail, items: Any, result: Any) -> bool:
    """``.shuffle(L, R)``: the members in a random order."""
    members = members_of(items, ".shuffle")
    mind.random.shuffle(members)
    return unify(result, make_list(members), trail)


@internal_action(".random", (1, 3), backtracks=True)
def random(mind: Any, trail: Trail, *args: Any) -> Iterator[None]:
    """``.random(X[, N])``: N random numbers from 0 to 1, one after another (once; 0: without end).

    ``.random(L, X[, N])``: random members of a list.
    """
    first = deref(args[0])
    mark = len(trail)
    if type(first) is List:
        members = members_of(first, ".random")
        if len(args) == 1:
            wrong_arguments(".random of a list needs a variable")
        target, times = args[1], _times(args[2]) if len(args) == 3 else 1
        if not members:
            return
        if type(deref(target)) is not Var:
            wrong_arguments("a variable is needed for a random member")
    else:
        if type(first) is not Var:
            wrong_arguments("the first argument of .random is a variable or a list")
        members, target, times = [], first, _times(args[1]) if len(args) > 1 else 1
    done = 0
    while times == 0 or done < times:
        done += 1
        value = mind.random.choice(members) if members else mind.random.random()
        if unify(target, value, trail):
            yield None
        undo(trail, mark)


def _times(term: Any) -> int:
    number = deref(term)
    if type(number) is not float:
        wrong_arguments(".random takes a number of times")
    return java_int(number)


@internal_action(".set_random_seed", 1)
def set_random_seed(mind: Any, trail: Trail, seed: Any) -> bool:
    """``.set_random_seed(N)``: the random numbers of this agent begin anew.

    Each agent has its own, seeded by the run.
    """
    number = deref(seed)
    if type(number) is not float:
        wrong_arguments("a random seed is a number")
    mind.random.seed(java_int(number))
    return True
