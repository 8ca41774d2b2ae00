"""What the agent thinks: the AgentSpeak language, the mind that runs it, and the agent daemon.

For programs of your own in Python: `Environment` and what belongs to it (docs/environments.md).
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from agentd.environment import ActionFailed, Deferred, Environment
    from agentd.language.terms import Literal, atom
    from agentd.values import literal, term_of, value_of

__all__ = ["ActionFailed", "Deferred", "Environment", "Literal", "atom", "literal", "term_of", "value_of"]

_PLACES = {
    "ActionFailed": "agentd.environment",
    "Deferred": "agentd.environment",
    "Environment": "agentd.environment",
    "Literal": "agentd.language.terms",
    "atom": "agentd.language.terms",
    "literal": "agentd.values",
    "term_of": "agentd.values",
    "value_of": "agentd.values",
}


def __getattr__(name: str) -> Any:
    """The public names are imported when they are first used: the daemon and its commands start without them."""
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_PLACES[name]), name)
