"""What the arguments of internal actions are, where they are no plain terms: formulas, code, beliefs."""

from __future__ import annotations

from agentd.language.syntax import InternalAction

_QUERIES = {
    ".findall": 1,
    ".setof": 1,
    ".count": 0,
    ".eval": 1,
    ".wait": 0,
    ".belief": 0,
    ".foreach": 0,
    ".loop": 0,
    ".if_then_else": 0,
}
"""The internal actions with a logical formula among their arguments, and which argument it is."""

RUNNERS = frozenset((".foreach", ".loop", ".if_then_else", ".fork", ".add_plan", ".send", ".broadcast"))
"""The internal actions that run, keep or send the code that stands in their arguments."""

ASSERTIONS = frozenset((".asserta", ".assertz"))
FILE_READERS = frozenset((".include", ".create_agent"))
"""The internal actions that read a program while an agent runs."""


def query_of(action: InternalAction) -> int | None:
    """The index of the argument that is a logical formula; None if there is none."""
    if action.name in (".min", ".max"):
        return 1 if len(action.args) == 3 else None
    return _QUERIES.get(action.name)
