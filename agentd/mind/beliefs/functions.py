"""Functions in terms: how they are called, and those that a program defines by a rule."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.terms import Literal, Var, deref
from agentd.mind.beliefs.term_copy import resolve
from agentd.mind.beliefs.unification import Trail, undo
from agentd.mind.state import MindState


class FunctionsOf(Mapping[tuple[str, int], Callable[..., Any]]):
    """The functions that a mind's program may call, by name and number of arguments, bound to the mind."""

    def __init__(self, mind: MindState) -> None:
        self._mind = mind

    def __getitem__(self, key: tuple[str, int]) -> Callable[..., Any]:
        compute = self._mind.compiler.find_function(*key)
        if compute is None:
            raise KeyError(key)
        return partial(compute, self._mind)

    def __iter__(self) -> Iterator[tuple[str, int]]:
        return iter(self._mind.compiler.functions())

    def __len__(self) -> int:
        return len(self._mind.compiler.functions())


def call(function: Any, mind: MindState, trail: Trail, sig: Any, args: tuple[Any, ...]) -> Any:
    """A function of the program; a call that cannot be computed stays a term."""
    value = function(mind, *[deref(a) for a in args])
    return Literal(sig, args) if value is None else value


def by_rule(name: str, arity: int) -> Callable[..., Any]:
    """The function that asks the rule ``name`` with one argument more, for its last one."""
    sig = signature(name, arity + 1)
    mode = (True,) * arity + (False,)

    def compute(mind: MindState, *args: Any) -> Any:
        action = mind.compiler.action(name, arity + 1)
        if action is not None:
            return _by_action(mind, action, args)
        trail: list[Var] = []
        for found in mind.beliefs.predicate(sig).solve(mode, (*args, None), mind, trail):
            value = resolve(deref(found[-1]))
            undo(trail, 0)
            return value
        return None

    return compute


def _by_action(mind: MindState, action: Any, args: tuple[Any, ...]) -> Any:
    result = Var("Result")
    trail: list[Var] = []
    outcome = action.guarded()(mind, trail, *args, result)
    value = None
    if next(iter(outcome), 0) is None if action.backtracks else outcome:
        value = resolve(result)
    undo(trail, 0)
    return value
