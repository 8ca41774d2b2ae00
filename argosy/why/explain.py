"""Explain what an agent does, from a view of its mind and from answers of the boards and the other agents."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterable
from pathlib import PurePath
from typing import Any, TypeVar

import msgspec
from msgspec.structs import replace

from argosy.cli.operator_bus import ANY, Unanswered, names_there
from argosy.why.answer import Explanation, Line, Paragraph
from argosy.why.current_state import doing, dropped, failure_paragraph, only_counted, standing
from argosy.why.decision_history import Memory
from argosy.why.decisions import WITHOUT_PLAN, decision_paragraph, groups
from argosy.why.goal_explanation import about as paragraphs_about
from argosy.why.goal_explanation import names_of
from argosy.why.question import subject_of
from argosy.why.unanswered_questions import MailFacts, dead_letters, question_paragraph
from argosy.why.wording import without_annotations
from commd.bus.bus import Bus
from schemas.files.findings import did_you_mean
from schemas.wire import keys
from schemas.wire.keys import is_name
from schemas.wire.mind_records import DecisionView, MindView
from schemas.wire.records import BoardServices, Mailboxes, Record

R = TypeVar("R", bound=Record)

REMEMBERED = 200
"""Decisions and failures that a mind is asked for; as many as it keeps by default."""
LAST = 5
"""Events that are explained by default."""
ANSWER_TIMEOUT = 5.0
"""Wall seconds that an agent has to answer."""
MAIL_TIMEOUT = 2.0
"""Wall seconds that boards and receivers have to answer."""
MOST_ASKED = 8
"""Receivers of open questions that are asked for their minds."""
NO_DECISIONS = "It remembers no decisions: none was made since its start, or it was started with --decisions 0."
S = TypeVar("S", bound=msgspec.Struct)
_PLACES = ("position", "at", "asked_at", "dropped_at", "program")
"""Fields that hold `file:line`, or a file, and nothing else; `uses` holds several."""


async def explain(bus: Bus, fleet: str, agent: str, about: str = "", last: int = LAST) -> Explanation:
    """Ask an agent, the boards, and the receivers of its open questions, and explain what it does.

    The `last` events are explained, 1 or more.
    Raises Unanswered if there is no such agent or it does not answer, and Findings for what nothing can be called.
    """
    if about:
        subject_of(about)
    fleet, view = await view_of(bus, fleet, agent)
    facts = MailFacts()
    if view.questions:
        facts = await mail_facts(bus, fleet, view)
    elif not about:
        facts.boards, facts.silent = await _mailboxes(bus, fleet)
    return explain_view(view, about, last=last, facts=facts)


def explain_view(view: MindView, about: str = "", *, last: int = LAST, facts: MailFacts | None = None) -> Explanation:
    """Explain from a view of a mind alone; it wants its plans (`?plans=true`) and many decisions (`last=200`)."""
    places, facts = Places(view), facts or MailFacts()
    facts = replace(facts, minds={name: places.near(mind) for name, mind in facts.minds.items()})
    memory, known = Memory(places.near(view)), True
    if about:
        subject = subject_of(about)
        paragraphs = paragraphs_about(memory, subject, last, facts)
        known = any(one.kind != "hint" for one in paragraphs) or subject.name in names_of(view)
    else:
        paragraphs = _now(memory, last, facts)
    if not view.decisions and not view.failures:
        paragraphs.append(Paragraph("hint", (Line(NO_DECISIONS),)))
    return Explanation(view.agent, about, memory.now, places.far(paragraphs), known)


def _now(memory: Memory, last: int, facts: MailFacts) -> list[Paragraph]:
    """Return its failures, oldest first, and then its present activity."""
    view = memory.view
    wrong = [one for one in memory.decisions if _went_wrong(one)]
    explained = [one.failure for one in wrong if one.failure is not None]
    goals = {one.cycle for one in wrong if one.chosen is None}
    happened = [decision_paragraph(memory, group) for group in groups(wrong)]
    happened += [
        failure_paragraph(memory, failure)
        for failure in memory.failures
        if failure not in explained and not (failure.error in WITHOUT_PLAN and failure.cycle in goals)
    ]
    happened += list(dropped(memory, view.drops))
    happened.sort(key=lambda paragraph: paragraph.time or 0.0)
    asked = [question_paragraph(memory, question, facts) for question in view.questions[-last:]]
    given_up = list(dead_letters(view.agent, facts, time.time_ns()))[-last:]
    return [*only_counted(view), *given_up, *happened[-last:], *asked, standing(memory), *doing(memory)]


def _went_wrong(made: DecisionView) -> bool:
    """Whether a plan was dropped or failed by itself, not only with one that it waited for, or no plan was found."""
    if made.failure is not None:
        if made.failure.error in WITHOUT_PLAN:
            return False  # the goal without a plan is explained instead
        return made.failure.given_up[:1] == (without_annotations(made.event),)
    return made.outcome == "dropped" or (made.chosen is None and made.kind[-1] in "!?")


async def view_of(bus: Bus, fleet: str, agent: str) -> tuple[str, MindView]:
    """Return the fleet of an agent and its mind. Raises Unanswered, which lists the agents that are there."""
    selector = f"{keys.mind(fleet, agent)}?plans=true;last={REMEMBERED}"
    found = await _all(bus, selector, MindView, ANSWER_TIMEOUT)
    if len(found) > 1:
        fleets = ", ".join(sorted(_chunk(key, 0) for key in found))
        raise Unanswered(f"several fleets have an agent {agent}: {fleets}; choose one by --fleet")
    for key, view in found.items():
        if isinstance(view, MindView):
            return _chunk(key, 0), view
        raise Unanswered(f"{agent}: {view}")
    there = sorted({name for _, name in await names_there(bus, fleet, "agentd")})
    where = "" if fleet == ANY else f" in fleet {fleet}"
    if not there:
        raise Unanswered(f"no agent is on the bus{where}: is agentd running, and is this its router?")
    if agent in there:
        raise Unanswered(
            f"{agent} is on the bus, but has not answered within {ANSWER_TIMEOUT:g} s: does its agentd hang?"
        )
    raise Unanswered(f"there is no agent `{agent}`{where}{did_you_mean(agent, there)}")


async def mail_facts(bus: Bus, fleet: str, view: MindView) -> MailFacts:
    """Ask the boards for mailboxes and agents, and the receivers of open questions for their minds."""
    asked = dict.fromkeys(question.receiver for question in view.questions)
    receivers = [one for one in asked if is_name(one)][
        :MOST_ASKED
    ]  # the name becomes part of a key, where `*` has a meaning
    queries = [f"{keys.mind(fleet, name)}?plans=true;last={REMEMBERED}" for name in receivers]
    minds_asked = asyncio.gather(*(_all(bus, query, MindView, MAIL_TIMEOUT) for query in queries))
    services_asked = _all(bus, keys.services(fleet, "*"), BoardServices, MAIL_TIMEOUT)
    (boards, silent), services, minds = await asyncio.gather(_mailboxes(bus, fleet), services_asked, minds_asked)
    homes = {agent: one.board for one in services.values() if isinstance(one, BoardServices) for agent in one.agents}
    pairs = zip(receivers, minds, strict=True)
    known = {name: one for name, found in pairs for one in found.values() if isinstance(one, MindView)}
    return MailFacts(boards, silent, homes, known, asked=True)


async def _mailboxes(bus: Bus, fleet: str) -> tuple[list[Mailboxes], dict[str, str]]:
    found = await _all(bus, keys.mailboxes(fleet, "*"), Mailboxes, MAIL_TIMEOUT)
    boards = [one for one in found.values() if isinstance(one, Mailboxes)]
    return boards, {_chunk(key, 1): one for key, one in found.items() if isinstance(one, str)}


async def _all(bus: Bus, selector: str, kind: type[R], seconds: float) -> dict[str, R | str]:
    """Return all answers by key: a record, or the error as text."""
    found: dict[str, R | str] = {}
    errors = await bus.ask_all(selector, kind, seconds, found.__setitem__)
    return errors | found


def _chunk(key: str, number: int) -> str:
    """Fleet (0) or name (1) of a key."""
    parsed = keys.parse(key)
    return "" if parsed is None else (parsed[0], parsed[1])[number]


class Places:
    """Removes the folder of a program from the positions in a view, and restores it in the lines about it.

    Other texts are not changed: programs and vehicles may print the same characters.
    """

    def __init__(self, view: MindView) -> None:
        self._folder = f"{PurePath(view.program).parent}/" if "/" in view.program else ""
        self._whole: dict[str, str] = {}

    def near(self, struct: S) -> S:
        """Return a view, or a part of one, with short positions."""
        return self._near(struct) if self._folder else struct

    def far(self, paragraphs: Iterable[Paragraph]) -> tuple[Paragraph, ...]:
        """Return paragraphs whose lines have their whole position; their texts keep the short one."""
        whole = self._whole
        return tuple(
            replace(
                one, lines=tuple(replace(line, position=whole.get(line.position, line.position)) for line in one.lines)
            )
            for one in paragraphs
        )

    def _near(self, struct: S) -> S:
        changes: dict[str, Any] = {}
        for name in struct.__struct_fields__:
            match name, getattr(struct, name):
                case _, str(text) if name in _PLACES and text.startswith(self._folder):
                    changes[name] = self._cut(text)
                case "uses", dict(uses):
                    changes[name] = {use: self._cut(place) for use, place in uses.items()}
                case _, msgspec.Struct() as inner:
                    changes[name] = self._near(inner)
                case _, tuple(several) if several and isinstance(several[0], msgspec.Struct):
                    changes[name] = tuple(map(self._near, several))
        return replace(struct, **changes) if changes else struct

    def _cut(self, place: str) -> str:
        short = place.removeprefix(self._folder)
        self._whole[short] = place
        return short
