"""What comes to an agent from elsewhere: from other agents, from those who start it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from agentd.analysis.mentions import Survey


@dataclass(frozen=True, slots=True)
class Elsewhere:
    """Beliefs and goals that others may send, as name and arity.

    ``complete`` says that nobody sends anything else; otherwise goals and beliefs are not held to be missing because
    the program does not set them itself. ``open_...`` say that others send some which cannot be seen in their programs.
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
    """What agents with these programs, and nobody else, send to one another."""
    surveys = list(surveys)
    told = {mention.indicator for each in surveys for mention in each.told}
    wanted = {mention.indicator for each in surveys for mention in (*each.wanted, *each.raised)}
    return Elsewhere(
        frozenset(told | RAISED_BY_AGENTD),
        frozenset(wanted | RAISED_BY_AGENTD),
        complete=True,
        open_beliefs=any(each.open_told for each in surveys),
        open_goals=any(each.open_wanted for each in surveys),
        open_plans=any(each.teaches for each in surveys),
        ends_goals=any(each.ends_others for each in surveys),
    )
