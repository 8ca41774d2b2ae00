"""The variables that occur in syntax."""

from __future__ import annotations

from typing import Any

from agentd.language import syntax


def is_plain_variable(node: Any) -> bool:
    """Whether a node is a variable without decorations."""
    return type(node) is syntax.Variable and node.annotations is None and not node.negated and node.namespace is None


def variables(node: Any, found: dict[str, None] | None = None) -> dict[str, None]:
    """The names of the variables in a syntax node, in order of occurrence, without anonymous ones."""
    if found is None:
        found = {}
    kind = type(node)
    if kind is syntax.Variable and not node.anonymous:
        found[node.name] = None
    if kind is tuple:
        for item in node:
            variables(item, found)
    elif hasattr(node, "__dataclass_fields__") and kind is not syntax.Position:
        for name in node.__dataclass_fields__:
            if name != "position":
                variables(getattr(node, name), found)
    return found
