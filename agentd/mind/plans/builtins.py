"""What the compiler of a program has to know about internal actions and functions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from agentd.language.compiler.constants import constant_term
from agentd.language.compiler.selection import Form
from agentd.language.syntax_tree import nodes
from agentd.mind.data import registry
from agentd.mind.data.registry import InternalAction, find_action


class Library:
    """The standard library and what a program adds to it."""

    def __init__(self) -> None:
        self.has_meta = False
        """Whether the program has plans for the states of goals, ``^!g``."""
        self.form: Form = "select"
        """How plans are to be selected: plainly, with the reasons why they are not, or with all their options."""
        self.namespaced = False
        """Whether the program knows other namespaces: then plain variables must refuse their literals (rule 100)."""
        self._own: dict[tuple[str, int], Callable[..., Any]] = {}
        self.rules_of_functions: dict[tuple[str, int], str] = {}
        """The rules that compute the program's own functions, by name and number of arguments."""
        self.unknown: dict[tuple[str, int], nodes.Position] = {}
        """Internal actions that the program uses and nobody knows, with the first place of each."""

    def register_function(self, name: str, arity: int, compute: Callable[..., Any]) -> None:
        """A function of the program's own (``{ register_function("my.f", 2, "rule") }``)."""
        self._own[(name, arity)] = compute

    def copy_functions(self, other: Library) -> None:
        """Take over the functions that another program has registered."""
        self._own.update(other._own)
        self.rules_of_functions.update(other.rules_of_functions)

    def is_function(self, name: str, arity: int) -> bool:
        return self.find_function(name, arity) is not None

    def is_own_function(self, name: str, arity: int) -> bool:
        """Whether the program has registered a function itself."""
        return (name, arity) in self._own

    def find_function(self, name: str, arity: int) -> Callable[..., Any] | None:
        """A function of the program's own, or a registered one."""
        return self._own.get((name, arity)) or registry.find_function(name, arity)

    def function(self, name: str, arity: int) -> Callable[..., Any]:
        found = self.find_function(name, arity)
        if found is None:
            raise KeyError(f"{name}/{arity}")
        return found

    def functions(self) -> set[tuple[str, int]]:
        """Names and numbers of arguments of all functions that are known by now."""
        return registry.FUNCTIONS.keys() | self._own.keys()

    def action(self, name: str, arity: int) -> InternalAction | None:
        return find_action(name, arity)

    def constant(self, node: Any) -> Any:
        """The term of a ground node."""
        return constant_term(node)

    def unknown_action(self, node: nodes.InternalAction) -> None:
        """Note an internal action that does not exist."""
        self.unknown.setdefault((node.name, len(node.args)), node.position)
