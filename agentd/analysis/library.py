"""The internal actions and functions that exist, with the arguments that they take."""

from __future__ import annotations

from collections.abc import Iterable

from agentd.analysis.arities import Arities
from agentd.analysis.mentions import Survey

STATEMENTS: dict[str, range | set[int]] = {
    ".foreach": {2},
    ".loop": {2},
    ".if_then_else": {2, 3},
    ".fork": range(2, 1 << 30),
}
"""Internal actions that the compiler reads as `for`, `while`, `if` and forks, with their numbers of arguments."""


def look_for_packages(survey: Survey) -> dict[str, str]:
    """Have the packages imported that provide names which a program uses; why some of them cannot be used."""
    from agentd.stdlib.registry import ASKED, find_action

    packages: dict[str, str] = {}
    for call in survey.calls:
        find_action(call.action.name, len(call.action.args))
        package = call.action.name.partition(".")[0]
        if reason := ASKED.get(package):
            packages[package] = reason
    return packages


def standard_library() -> tuple[Arities, Arities]:
    """The internal actions and the functions that are registered: those of the standard library and of packages."""
    from agentd.stdlib.registry import ACTIONS, FUNCTIONS

    actions = {name: _union(action.arities for action in group) for name, group in ACTIONS.items()} | STATEMENTS
    functions: dict[str, set[int]] = {".count": {1}}
    for name, arity in FUNCTIONS:
        functions.setdefault(name, set()).add(arity)
    return actions, functions


def _union(ranges: Iterable[range]) -> range | set[int]:
    ranges = list(ranges)
    if len(ranges) == 1:
        return ranges[0]
    widest = max(ranges, key=len)
    return widest if len(widest) > 99 else {arity for each in ranges for arity in each}
