"""Symbols that a program gets from elsewhere: other agents, agentd, and the standard library with its arguments."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from agentd.check.symbol_table import Survey
from schemas.humanize import joined

Arities: TypeAlias = Mapping[str, int | Collection[int]]
"""Names with the numbers of arguments that they take; a `range` is such a collection."""


def takes(arities: int | Collection[int], arity: int) -> bool:
    """Return whether `arity`, 0 or more, is one of the numbers of arguments that something takes."""
    return arity == arities if isinstance(arities, int) else arity in arities


def arguments(arities: int | Collection[int]) -> str:
    """Return the numbers of arguments, each 0 or more, that something takes as text."""
    if isinstance(arities, range) and len(arities) > 9:
        return f"at least {arities.start} argument{'s' * (arities.start != 1)}" if arities.start else "any arguments"
    numbers = [arities] if isinstance(arities, int) else sorted(set(arities))
    if numbers == [0]:
        return "no arguments"
    return f"{joined(list(map(str, numbers)), 'or')} argument{'s' * (numbers != [1])}"


@dataclass(frozen=True, slots=True)
class Elsewhere:
    """Beliefs and goals that others may send, as name and arity.

    ``complete``: nobody sends anything else; otherwise goals and beliefs are not reported as missing because the
    program does not set them itself. ``open_...``: others send some which cannot be seen in their programs.
    """

    beliefs: frozenset[tuple[str, int]] = frozenset()
    goals: frozenset[tuple[str, int]] = frozenset()
    complete: bool = False
    open_beliefs: bool = False
    open_goals: bool = False
    open_plans: bool = False
    no_percepts: bool = False
    """Whether it is known that no environment gives percepts: without it they may be of any name."""
    ends_goals: bool = False
    """Whether one of them can end the goals of another, or the other itself, while it runs."""


RAISED_BY_AGENTD = frozenset(
    (
        ("jag_shutting_down", 1),
        ("jag_sleeping", 0),
        ("jag_awaking", 0),
        ("kqml_received", 4),
        ("provider", 2),
        ("online", 1),
        ("undelivered", 4),
        ("restarted", 1),
        ("interrupted", 3),
    )
)
"""Events and beliefs that the interpreter itself raises: `.stopMAS(Ms)`, messages, `.df_subscribe`, presence, mail that
was given up, a restart and the actions that it interrupted."""


def from_team(surveys: Iterable[Survey]) -> Elsewhere:
    """Return the messages that agents with these programs send to one another, without those of others."""
    surveys = list(surveys)
    sent = {mention.indicator for each in surveys for mention in each.sent}
    wanted = {mention.indicator for each in surveys for mention in (*each.wanted, *each.raised)}
    return Elsewhere(
        frozenset(sent | RAISED_BY_AGENTD),
        frozenset(wanted | RAISED_BY_AGENTD),
        complete=True,
        open_beliefs=any(each.open_sent for each in surveys),
        open_goals=any(each.open_wanted for each in surveys),
        open_plans=any(each.teaches for each in surveys),
        ends_goals=any(each.ends_others for each in surveys),
    )


STATEMENTS: dict[str, Collection[int]] = {
    ".foreach": {2},
    ".loop": {2},
    ".if_then_else": {2, 3},
    ".fork": range(2, 1 << 30),
}
"""Internal actions that the compiler reads as `for`, `while`, `if` and forks, with their numbers of arguments."""


def look_for_packages(survey: Survey) -> dict[str, str]:
    """Have the packages imported that provide names which a program uses; why some of them cannot be used."""
    from agentd.mind.data.registry import ASKED, find_action

    packages: dict[str, str] = {}
    for call in survey.calls:
        find_action(call.action.name, len(call.action.args))
        package = call.action.name.partition(".")[0]
        if reason := ASKED.get(package):
            packages[package] = reason
    return packages


def standard_library() -> tuple[Arities, Arities]:
    """Return the registered internal actions and functions: those of the standard library and of packages."""
    from agentd.mind.data.registry import ACTIONS, FUNCTIONS

    actions: dict[str, Collection[int]] = {}
    for name, group in ACTIONS.items():
        widest = max((action.arities for action in group), key=len)
        actions[name] = widest if len(widest) > 99 else {arity for action in group for arity in action.arities}
    functions: dict[str, set[int]] = {".count": {1}}
    for name, arity in FUNCTIONS:
        functions.setdefault(name, set()).add(arity)
    return actions | STATEMENTS, functions
