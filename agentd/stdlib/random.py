"""Chance: random numbers, members and orders, all from the mind's own seeded source."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count
from random import Random
from typing import TYPE_CHECKING, Any, Final, TypeVar

from agentd.language.terms.numbers import java_int
from agentd.language.terms.terms import List, Term, Var, deref, make_list
from agentd.mind.beliefs.unification import Trail, alternatives, unify
from agentd.mind.data.formula_failure import argument, wrong_arguments
from agentd.mind.data.registry import internal_action
from agentd.mind.state import MindState
from agentd.stdlib.lists import members_of

if TYPE_CHECKING:
    from _typeshed import SupportsLenAndGetItem

_T = TypeVar("_T")
_MULTIPLIER: Final = 0x5DEECE66D
_MASK: Final = (1 << 48) - 1


class JavaRandom(Random):
    """The numbers of ``java.util.Random``: a linear congruential generator of 48 bits, as documented there.

    Of ``seed`` the lowest 48 bits count.
    """

    def __init__(self, seed: int) -> None:
        super().__init__()
        self._state = (seed ^ _MULTIPLIER) & _MASK

    def _next(self, bits: int) -> int:
        self._state = (self._state * _MULTIPLIER + 0xB) & _MASK
        return self._state >> (48 - bits)

    def random(self) -> float:
        """The next number from 0 to 1, as ``nextDouble``."""
        return ((self._next(26) << 27) + self._next(27)) / (1 << 53)

    def choice(self, seq: SupportsLenAndGetItem[_T]) -> _T:
        """A member, by ``nextInt(bound)``."""
        bound = len(seq)
        if bound & (bound - 1) == 0:
            return seq[(bound * self._next(31)) >> 31]
        while True:
            bits = self._next(31)
            if bits - bits % bound + bound - 1 < 1 << 31:
                return seq[bits % bound]


@internal_action(".shuffle", 2)
def shuffle(mind: MindState, trail: Trail, items: Term, result: Term) -> bool:
    """``.shuffle(L, R)``: the members in a random order."""
    members = members_of(items, ".shuffle")
    mind.random.shuffle(members)
    return unify(result, make_list(members), trail)


@internal_action(".random", (1, 3), backtracks=True)
def random(mind: MindState, trail: Trail, *args: Any) -> Iterator[None]:
    """``.random(X[, N])``: N random numbers from 0 to 1, one after another (once; 0: without end).

    ``.random(L, X[, N])``: random members of a list.
    """
    first = deref(args[0])
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
    rounds = count() if times == 0 else range(times)
    values = (mind.random.choice(members) if members else mind.random.random() for _ in rounds)
    yield from alternatives(target, values, trail)


def _times(term: Term) -> int:
    return java_int(argument(float, term, ".random takes a number of times"))


@internal_action(".set_random_seed", 1)
def set_random_seed(mind: MindState, trail: Trail, seed: Term) -> bool:
    """``.set_random_seed(N)``: the random numbers of this agent are from now on those of Java's generator for a seed.

    Until then each agent has numbers of its own, seeded by the run.
    """
    mind.random = JavaRandom(java_int(argument(float, seed, "a random seed is a number")))
    return True
