"""The variables that occur in syntax."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

from agentd.language import syntax

HIDDEN = "computed "
"""How the names of variables begin that no program can write."""


def is_plain_variable(node: Any) -> bool:
    """Whether a node is a variable without decorations."""
    return type(node) is syntax.Variable and node.annotations is None and not node.negated and node.namespace is None


def variables(node: Any) -> dict[str, None]:
    """The names of the variables in a syntax node, in order of occurrence, without anonymous ones. At any depth."""
    found: dict[str, None] = {}
    pending = [node]
    while pending:
        node = pending.pop()
        kind = type(node)
        if kind is tuple:
            pending.extend(reversed(node))
            continue
        if kind is syntax.Variable and not node.anonymous:
            found[node.name] = None
        names = _PARTS.get(kind)
        if names is None:
            names = _PARTS[kind] = _part_names(kind)
        for name in names:
            part = getattr(node, name)
            if part is not None:
                pending.append(part)
    return found


_PARTS: dict[type, tuple[str, ...]] = {syntax.Position: ()}
"""The fields of each class that may hold variables, the last first."""


def _part_names(kind: type) -> tuple[str, ...]:
    if not is_dataclass(kind):
        return ()
    return tuple(f.name for f in reversed(fields(kind)) if f.name not in ("position", "operator", "functor", "negated"))
