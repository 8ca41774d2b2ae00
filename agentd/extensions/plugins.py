"""Internal actions and functions of other packages, found by their entry points when a program uses them.

A package that declares

    [project.entry-points."argosy.internal_actions"]
    mylib = "mylib_for_agents"

provides the names ``mylib.anything``: its module is imported when a program is compiled that uses one, and registers
them by the decorators `agentd.internal_action` and `agentd.function`. An entry point that names a function
(``module:register``) has it called. Nothing is looked for while programs use only what agentd has itself.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import Any

from agentd.language.terms.numbers import UndefinedNumber
from agentd.mind.beliefs import unification
from agentd.mind.data import registry
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.registry import ACTIONS, FUNCTIONS, SOURCES
from agentd.values import term_of
from commd.process.user_code import MISTAKES, describe_error

GROUP = "argosy.internal_actions"


class PluginError(RuntimeError):
    """An error in another package's code; the text gives its name, the error and the place."""


def unify(one: Any, other: Any, trail: unification.Trail) -> bool:
    """Unify as `unification.unify` does, terms or Python values (`term_of`)."""
    return unification.unify(term_of(one), term_of(other), trail)


def function(name: str, *arities: int, pure: bool = False) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Register a function as `registry.function` does. Its result is a term or a Python value; None: there is none."""

    def register(compute: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(compute)
        def term(*arguments: Any) -> Any:
            return None if (result := compute(*arguments)) is None else term_of(result)

        registry.function(name, *arities, pure=pure)(term)
        return compute

    return register


def discover() -> None:
    """From now on, look for the names that programs use in other packages."""
    if load_plugin not in SOURCES:
        SOURCES.append(load_plugin)


def load_plugin(package: str) -> str | None:
    """Import what provides ``package.name``. Returns why it cannot be used, or None: also when there is nothing."""
    from importlib.metadata import entry_points  # takes longer than most programs need to start

    before = {id(action) for group in ACTIONS.values() for action in group}, set(FUNCTIONS)
    for entry in sorted(entry_points(group=GROUP, name=package), key=lambda entry: entry.value):
        try:
            loaded = entry.load()
            if callable(loaded):
                loaded()
        except MISTAKES as error:
            origin = "" if entry.dist is None else f" of {entry.dist.name} {entry.dist.version}"
            return f"the plug-in {package}{origin} cannot be loaded: {describe_error(error)}"
    for name, group in ACTIONS.items():
        for action in group:
            if id(action) not in before[0]:
                action.function = _named(name, action.function, action.backtracks)
    for key in FUNCTIONS.keys() - before[1]:
        FUNCTIONS[key] = _named(key[0], FUNCTIONS[key], False)
    return None


def _named(name: str, function: Callable[..., Any], backtracks: bool) -> Callable[..., Any]:
    """Yield the function, with unexpected errors reported by its name and place."""

    def failed(error: BaseException) -> PluginError:
        return PluginError(f"{name}: {describe_error(error)}")

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        try:
            return function(*arguments)
        except (Failed, UndefinedNumber, RecursionError):
            raise
        except MISTAKES as error:
            raise failed(error) from error

    @functools.wraps(function)
    def answers(*arguments: Any) -> Iterator[Any]:
        try:
            yield from function(*arguments)
        except (Failed, UndefinedNumber, RecursionError):
            raise
        except MISTAKES as error:
            raise failed(error) from error

    return answers if backtracks else call
