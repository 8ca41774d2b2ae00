"""The view of a mind for observers, as records: bounded, filtered as asked for, and reused where nothing changed.

What is asked for are the parameters of a query, `{agent}/mind?plans=true;last=200;about=go`: a `Look`.
"""

from __future__ import annotations

import re
from itertools import islice
from typing import Any, Final

from msgspec import Struct
from msgspec.structs import replace

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.printer import source_text
from agentd.language.terms.format import flat_text, text
from agentd.language.terms.terms import EMPTY, List, Literal
from agentd.mind import Mind
from agentd.mind.introspection.decision_log import Decision, Failure, record_of
from agentd.mind.introspection.decision_views import Views, is_about, plan_view, written
from agentd.mind.introspection.snapshots import event_view, held, intention_views, place, question_views, sources_of
from agentd.mind.plans.plan_library import Plan
from schemas.wire.mind_records import (
    BeliefView,
    DecisionView,
    EventView,
    FailureView,
    IntentionView,
    MindView,
    PlanView,
)

MOST_PLANS: Final = 10
"""Plans shown of a decision, of those rejected and of those untried."""
MOST_INTENTIONS: Final = 100
MOST_EVENTS: Final = 50
MOST_QUESTIONS: Final = 50
MOST_LISTED_PLANS: Final = 1000
MOST_NAMES: Final = 20
"""Names whose plans were asked for and are remembered."""
MOST_USES: Final = 60
"""Formulas named of a plan's body."""
LONGEST_BELIEF: Final = 2_000
"""Characters shown of a belief."""
_MOST_LOOKED_AT: Final = 2_000
"""Parts of a belief that are examined."""


LAST_DECISIONS: Final = 20
"""Number of last decisions and failures in a view of a mind, unless the query asks for more."""
MOST_DECISIONS: Final = 200
MOST_BELIEFS: Final = 500

_EXPECTED: Final = "expected plans=true, last=N, beliefs=N or about=NAME"
_NAME: Final = re.compile(r"~?[\w.:]+(/\d+)?")


class BadParameter(ValueError):
    """An invalid parameter of a query for a mind; the text has the parameter and what was expected."""


class Look(Struct, frozen=True):
    """Parameters of a query for a mind."""

    plans: bool = False
    last: int = LAST_DECISIONS
    """Number of decisions and failures."""
    beliefs: int = MOST_BELIEFS
    """Number of beliefs at most."""
    about: str = ""
    """A functor: only beliefs, events, plans and decisions of this name."""

    @staticmethod
    def of(parameters: dict[str, str]) -> Look:
        """Read the parameters of a query. Raises BadParameter."""
        look = Look()
        for name, value in parameters.items():
            match name:
                case "plans" if value in ("true", "false", ""):
                    look = replace(look, plans=value != "false")
                case "last":
                    look = replace(look, last=_number(name, value, MOST_DECISIONS))
                case "beliefs":
                    look = replace(look, beliefs=_number(name, value, MOST_BELIEFS))
                case "about" if _NAME.fullmatch(value):
                    look = replace(look, about=value.partition("/")[0])
                case _:
                    parameter = f"{name}={value}" if value else name
                    raise BadParameter(f"{parameter[:100]}: {_EXPECTED}")
        return look


EVERYTHING: Final = Look()


def _number(name: str, value: str, most: int) -> int:
    if value.isdecimal() and len(value) < 10 and int(value) <= most:
        return int(value)
    raise BadParameter(f"{name}={value[:20]}: expected a number from 0 to {most}")


class MindViews:
    """The views of one mind."""

    def __init__(self, mind: Mind, agent_boot: str = "") -> None:
        """``agent_boot`` is the end of the ids of its messages."""
        self._mind, self._agent_boot = mind, agent_boot
        self._beliefs, self._plans = Beliefs(mind), Plans(mind)

    def view(self, look: Look, now: float) -> MindView:
        """Return the state of the mind itself, at ``now`` in mission seconds; its host adds further fields."""
        mind = self._mind
        beliefs, beliefs_left_out = self._beliefs.shown(look, now)
        intentions, intentions_left_out = intentions_of(mind)
        events, events_left_out = events_of(mind, look.about)
        decisions, failures = decisions_of(mind, look)
        return MindView(
            agent=mind.name,
            program=mind.program.file,
            cycle=mind.cycle,
            time=now,
            state="reasoning" if mind.ready else "waiting",
            beliefs=beliefs,
            beliefs_left_out=beliefs_left_out,
            intentions=intentions,
            intentions_left_out=intentions_left_out,
            events=events,
            events_left_out=events_left_out,
            mailbox=len(mind.mailbox),
            questions=tuple(question_views(mind, self._agent_boot)[:MOST_QUESTIONS]),
            plans=self._plans.shown(look),
            plan_count=len(mind.plans.plans),
            decisions=decisions,
            failures=failures,
            dropped=dict(mind.drops.counts),
            drops=tuple(mind.drops.by_name.values()),
        )


class Beliefs:
    """The beliefs of a mind as records. The record of a fact is reused while the fact is believed."""

    def __init__(self, mind: Mind) -> None:
        self._mind = mind
        self._shown: dict[int, tuple[Literal, BeliefView]] = {}
        """The records of unchangeable facts shown last, by identity of the fact, which this keeps alive."""
        self._whole = False
        """Whether everything was shown last."""

    def shown(self, look: Look, now: float) -> tuple[tuple[BeliefView, ...], int]:
        """Return the beliefs, and how many more there are; ``now`` in mission seconds."""
        facts, count = self._believed(look.beliefs, look.about)
        before, known = self._shown, dict[int, tuple[Literal, BeliefView]]()
        views: list[BeliefView] = []
        for fact in facts:
            entry = before.get(id(fact))
            if entry is None:
                view, stays = self._view(fact, None if look.about or look.beliefs != MOST_BELIEFS else now)
                if stays:
                    known[id(fact)] = (fact, view)
            else:
                view = entry[1]
                known[id(fact)] = entry
            views.append(view)
        if not look.about and look.beliefs == MOST_BELIEFS:
            self._shown, self._whole = known, count == len(facts)
        return tuple(views), count - len(facts)

    def _believed(self, most: int, about: str) -> tuple[list[Literal], int]:
        """Return the facts to show and how many there are; ``about`` is their functor, empty for any.

        Each predicate has an equal share of the room, newest facts first, so that one with many facts hides no other.
        """
        predicates = [p for p in self._mind.beliefs.predicates() if not about or p.sig.functor == about]
        sizes = [len(predicate.entries) - predicate.rules for predicate in predicates]
        share = most
        left, room = sum(sizes), most
        if left > most:
            share = 0
            for rank, size in enumerate(sorted(sizes)):
                share = max(1, room // (len(sizes) - rank))
                room -= min(size, share)
        shown: list[Literal] = []
        for predicate, size in zip(predicates, sizes, strict=True):
            if size:
                facts = (entry for entry in reversed(predicate.entries.values()) if type(entry) is Literal)
                shown += islice(facts, min(share, most - len(shown)))
        return shown, left

    def _view(self, fact: Literal, new: float | None) -> tuple[BeliefView, bool]:
        """Return the record of a belief not shown last, and whether it is valid while the fact is believed.

        If everything was shown last, the belief is as old as ``new``, in mission seconds.
        """
        base = self._mind.beliefs
        shown, stays = _belief_text(fact)
        since, known = base.since(fact)
        if not base.dated and self._whole and stays:
            since = new
        return BeliefView(text=shown, sources=sources_of(fact), since=since), stays and known


def _belief_text(fact: Literal) -> tuple[str, bool]:
    """Return the text of a belief with its annotations, cut at `LONGEST_BELIEF`, and whether it cannot change."""
    whole = flat_text(fact)
    if whole is not None:
        return whole, fact.ground
    whole = text(held(fact))
    return whole if len(whole) <= LONGEST_BELIEF else f"{whole[: LONGEST_BELIEF - 3]}...", _lasting(fact)


def _lasting(fact: Literal) -> bool:
    """Return whether a fact consists of numbers, strings, structures and lists of these, and of few."""
    pending: list[Any] = [*fact.args, *fact.annots]
    for _ in range(_MOST_LOOKED_AT):
        if not pending:
            return fact.ground
        part = pending.pop()
        kind = type(part)
        if kind is Literal:
            pending += part.args
            pending += part.annots
        elif kind is List:
            if part is not EMPTY:
                pending += (part.tail, *part.items[part.at : part.at + _MOST_LOOKED_AT])
        elif kind is not float and kind is not str:
            return False
    return False


def intentions_of(mind: Mind) -> tuple[tuple[IntentionView, ...], int]:
    """Return the intentions, and how many more there are."""
    shown = tuple(intention_views(mind, MOST_INTENTIONS))
    if len(shown) < MOST_INTENTIONS:
        return shown, 0
    return shown, sum(bool(intention.stack) for intention in mind.all_intentions()) - len(shown)


def events_of(mind: Mind, about: str) -> tuple[tuple[EventView, ...], int]:
    """Return the next events, of the name ``about`` if it is not empty, and how many more wait."""
    events = mind.all_events()
    shown = [event for event in events[:MOST_EVENTS] if not about or event[0].sig.functor == about]
    return tuple(map(event_view, shown)), max(0, len(events) - MOST_EVENTS)


class Plans:
    """The plans of a mind as records, made again when the library has changed."""

    def __init__(self, mind: Mind) -> None:
        self._mind = mind
        self._version = -1
        self._made: dict[str, tuple[PlanView, ...]] = {}

    def shown(self, look: Look) -> tuple[PlanView, ...]:
        """Return the plans in order, if they are asked for."""
        if not look.plans:
            return ()
        if self._version != self._mind.plans.version or len(self._made) > MOST_NAMES:
            self._version, self._made = self._mind.plans.version, {}
        made = self._made.get(look.about)
        if made is None:
            plans = (plan for plan in self._mind.plans if not look.about or _functor(plan) == look.about)
            made = self._made[look.about] = tuple(_plan(plan) for plan in islice(plans, MOST_LISTED_PLANS))
        return made


def _functor(plan: Plan) -> str:
    literal = plan.syntax.trigger.literal
    return literal.functor if isinstance(literal, nodes.Structure) else ""


def _plan(plan: Plan) -> PlanView:
    context = plan.syntax.context
    return replace(
        plan_view(plan),
        context="" if context is None else written(source_text(context)),
        uses=plan_uses(plan.syntax),
        source=source_text(plan.syntax),
    )


def plan_uses(plan: nodes.Plan) -> dict[str, str]:
    """Return the formulas of a plan's body, each with the ``file:line`` of its first place.

    ``!go/1`` and ``!!serve/0`` are goals, ``?where/1`` tests, ``+found/3`` and ``-found/3`` changes of beliefs,
    ``takeoff/1`` actions, ``.send/4`` internal actions.
    """
    found: dict[str, str] = {}
    pending: list[object] = [plan.body]
    while pending and len(found) < MOST_USES:
        node = pending.pop(0)
        match node:
            case nodes.Body(formulas=formulas):
                pending[:0] = formulas
            case nodes.If(branches=branches, otherwise=otherwise):
                pending[:0] = [body for _, body in branches] + ([] if otherwise is None else [otherwise])
            case nodes.While(body=body) | nodes.For(body=body):
                pending.insert(0, body)
            case nodes.Fork(branches=bodies):
                pending[:0] = bodies
            case nodes.Step(operator=operator, term=term, position=position):
                name = _name(term)
                if name:
                    found.setdefault(operator.value + name, place(position))
    return found


def _name(term: nodes.Term) -> str:
    match term:
        case nodes.Structure(functor=functor, args=args, negated=negated):
            return f"{'~' if negated else ''}{functor}/{len(args)}"
        case nodes.InternalAction(name=name, args=args):
            return f"{name}/{len(args)}"
    return ""


def decisions_of(mind: Mind, look: Look = EVERYTHING) -> tuple[tuple[DecisionView, ...], tuple[FailureView, ...]]:
    """Return the last decisions and failures. The record of a decision with a known outcome is made once."""
    recorder, most = mind.recorder, look.last
    if recorder is None or not most:
        return (), ()
    entries, known = recorder.entries(), recorder.shown
    wanted = [entry for entry in entries if is_about(record_of(entry), look.about)] if look.about else entries
    views: Views | None = None
    made: list[DecisionView | FailureView] = []
    for entry in wanted[-most:]:
        record = known[id(entry)][1] if id(entry) in known else None
        if record is None or (isinstance(record, DecisionView) and record.outcome == "running"):
            if views is None:
                views = Views(mind, list(map(record_of, entries)))
            record = _record(views, record_of(entry), record)
            known[id(entry)] = (entry, record)
        made.append(record)
    if len(known) > len(entries):
        here = set(map(id, entries))
        for gone in [identity for identity in known if identity not in here]:
            del known[gone]
    decisions = tuple(record for record in made if isinstance(record, DecisionView))
    return decisions, tuple(record for record in made if isinstance(record, FailureView))


def _record(views: Views, record: Decision | Failure, before: DecisionView | None) -> DecisionView | FailureView:
    """Return a record with at most `MOST_PLANS` plans of a kind; ``before`` if the outcome is still the same."""
    if before is not None and isinstance(record, Decision) and views.outcome(record) == before.outcome:
        return before
    view = views.of(record)
    if isinstance(view, DecisionView) and max(len(view.rejected), len(view.untried)) > MOST_PLANS:
        return replace(view, rejected=view.rejected[:MOST_PLANS], untried=view.untried[:MOST_PLANS])
    return view
