"""Beliefs that are tested and that nobody ever adds, percepts tested with another number of arguments."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from agentd.check.external_knowledge import RAISED_BY_AGENTD, Arities, Elsewhere, arguments, takes
from agentd.check.finding_kinds import Kind, warning
from agentd.check.symbol_table import Mention, Survey
from agentd.language.errors.suggestions import near
from schemas.files.findings import Finding

_TRUTH = {("true", 0), ("false", 0)}


def beliefs_never_added(survey: Survey, percepts: Arities | None, elsewhere: Elsewhere) -> Iterator[Finding]:
    """Tests of beliefs that are no percept and that no line adds.

    Beliefs that another agent may tell look the same, and a program may be written for several robots, so these are
    warnings. Where percepts are not known only what looks misspelt is told.
    """
    held = _held(survey, elsewhere.beliefs)
    by_name: dict[str, set[int]] = {}
    for name, arity in held - RAISED_BY_AGENTD:
        by_name.setdefault(name, set()).add(arity)
    known = percepts is not None or (elsewhere.complete and elsewhere.no_percepts and not survey.actions)
    for test, tested_as_goal in [*((m, False) for m in survey.tested), *((m, True) for m in survey.asked)]:
        if test.indicator in held or test.from_others or test.indicator in _TRUTH:
            continue
        perceived = percepts.get(test.name) if percepts is not None else None
        if perceived is not None:
            if not takes(perceived, test.arity):
                text = f"the percept {test.name} has {arguments(perceived)}, not {test.arity}"
                text = f"{text}: {_consequence(test, tested_as_goal)}"
                yield warning(Kind.PERCEPT_ARITY, test.position, text)
            continue
        if survey.open_beliefs or elsewhere.open_beliefs:
            continue
        hint = _hint(test, by_name, percepts)
        if known or (hint and _base(test.name) not in map(_base, by_name)):
            text = f"nothing adds the belief {test.name}/{test.arity}"
            if percepts is not None:
                text += ", and no percept has its name: unless an agent or a mission tells it, "
            else:
                text += ": unless it is a percept or told, "
            text = f"{text}{_consequence(test, tested_as_goal)}{hint}"
            yield warning(Kind.BELIEF_NEVER_ADDED, test.position, text)


def events_never_perceived(survey: Survey, percepts: Arities, elsewhere: Elsewhere) -> Iterator[Finding]:
    """Plans for a percept with a number of arguments that it does not have, or for what is no percept."""
    added = {mention.indicator for mention in (*survey.added, *survey.raised)} | elsewhere.beliefs | RAISED_BY_AGENTD
    for placed in (plan for family in survey.families for plan in family):
        if placed.event not in ("+", "-") or placed.name is None or placed.indicator in added or placed.names_source:
            continue
        arities = percepts.get(placed.name)
        place = placed.plan.trigger.position
        if arities is None:
            if not (survey.open_beliefs or elsewhere.open_beliefs):
                text = f"nothing adds the belief {placed.name}/{placed.arity}, and no percept has its name: "
                text += f"unless an agent or a mission tells it, this plan never runs{near(placed.name, percepts)}"
                yield warning(Kind.UNKNOWN_PERCEPT, place, text)
        elif not takes(arities, placed.arity):
            text = f"the percept {placed.name} has {arguments(arities)}, not {placed.arity}: this plan never runs"
            yield warning(Kind.PERCEPT_ARITY, place, text)


def _held(survey: Survey, beliefs: Iterable[tuple[str, int]]) -> set[tuple[str, int]]:
    """What may come to be believed, as far as the program shows; a plan +b means that b is expected from somewhere."""
    held = {mention.indicator for mention in survey.added} | set(beliefs)
    for placed in survey.plans:
        if placed.event in ("+", "+?") and placed.name is not None:
            held.add((placed.name, placed.arity))
    return held


def _base(name: str) -> str:
    """A name without its namespace."""
    return name.rpartition("::")[2]


def _consequence(test: Mention, tested_as_goal: bool) -> str:
    arguments_written = f"({','.join('_' * test.arity)})" if test.arity else ""
    literal = f"{test.name}{arguments_written}"
    if tested_as_goal:
        return f"?{literal} always fails"
    return f"not {literal} is always true" if test.inverted else f"{literal} is always false"


def _hint(test: Mention, by_name: dict[str, set[int]], percepts: Arities | None) -> str:
    if test.name in by_name:
        return f"; there is {test.name} with {arguments(by_name[test.name])}"
    return near(test.name, {*by_name, *(percepts or ())})
