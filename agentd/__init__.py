"""Agents: the AgentSpeak language, the mind that runs it, and the agent daemon.

The names below are for programs of your own in Python: minds to embed (docs/guides/extending.md), environments
(docs/guides/extending.md), internal actions and functions (docs/guides/extending.md).
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from agentd.environment import ActionFailed, Deferred, Environment
    from agentd.extensions.plugins import function, unify
    from agentd.language.terms.terms import Literal, atom, deref
    from agentd.mind import Mind
    from agentd.mind.beliefs.unification import undo
    from agentd.mind.data.formula_failure import Failed
    from agentd.mind.data.registry import internal_action
    from agentd.mind.execution.waiting import suspend
    from agentd.mind.state import MindState
    from agentd.runtime.program_paths import compile_file, compile_text
    from agentd.values import literal, term_of, value_of

_PLACES = {
    "agentd.runtime.program_paths": ("compile_file", "compile_text"),
    "agentd.environment": ("ActionFailed", "Deferred", "Environment"),
    "agentd.extensions.plugins": ("function", "unify"),
    "agentd.language.terms.terms": ("Literal", "atom", "deref"),
    "agentd.mind": ("Mind",),
    "agentd.mind.data.formula_failure": ("Failed",),
    "agentd.mind.state": ("MindState",),
    "agentd.mind.execution.waiting": ("suspend",),
    "agentd.mind.beliefs.unification": ("undo",),
    "agentd.mind.data.registry": ("internal_action",),
    "agentd.values": ("literal", "term_of", "value_of"),
}

__all__ = [
    "ActionFailed",
    "Deferred",
    "Environment",
    "Failed",
    "Literal",
    "Mind",
    "MindState",
    "atom",
    "compile_file",
    "compile_text",
    "deref",
    "function",
    "internal_action",
    "literal",
    "suspend",
    "term_of",
    "undo",
    "unify",
    "value_of",
]


def __getattr__(name: str) -> Any:
    """The public names are imported when they are first used: the daemon and its commands start without them."""
    for module, names in _PLACES.items():
        if name in names:
            return getattr(import_module(module), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
