"""What a mind shows of itself to observers, as records: bounded, and what is as before is not made again."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import islice
from typing import Any, Final, TypeVar

import msgspec

from agentd.conversion.introspection import EVERYTHING, MOST_BELIEFS, Look
from agentd.language.syntax_tree.printer import source_text
from agentd.language.terms.terms import Literal
from agentd.mind import Mind
from agentd.mind.introspection.decision_log import record_of
from agentd.mind.introspection.decision_views import (
    DecisionView,
    FailureView,
    PlanView,
    RejectedView,
    Views,
    is_about,
    plan_view,
    written,
)
from agentd.mind.introspection.mind_snapshot import belief_text, believed, sources_of
from agentd.mind.plans.plan_usage import plan_context, plan_uses
from schemas.wire import mind_records

V = TypeVar("V")

MOST_PLANS: Final = 10
"""So many plans of a decision are shown."""
MOST_INTENTIONS: Final = 100
MOST_GOALS: Final = 100
"""So many goals of an intention are shown, the top of its stack first."""
MOST_EVENTS: Final = 50
MOST_QUESTIONS: Final = 50
MOST_LISTED_PLANS: Final = 1000
MOST_NAMES: Final = 20
"""So many names whose plans were asked for are remembered."""


class Beliefs:
    """The beliefs of a mind as records; those that are still there are made once."""

    def __init__(self, mind: Mind) -> None:
        self._mind = mind
        self._shown: dict[int, tuple[Literal, mind_records.BeliefView]] = {}
        """What the last look has shown of facts that do not change, by their identity; it keeps them alive."""
        self._whole = False
        """Whether the last look has shown everything."""

    def shown(self, look: Look, now: float) -> tuple[tuple[mind_records.BeliefView, ...], int]:
        """The beliefs, and how many more there are."""
        facts, count = believed(self._mind, look.beliefs, look.about)
        before, known = self._shown, dict[int, tuple[Literal, mind_records.BeliefView]]()
        views: list[mind_records.BeliefView] = []
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

    def _view(self, fact: Literal, new: float | None) -> tuple[mind_records.BeliefView, bool]:
        """A belief that the last look has not shown, and so is `new` if that one has shown everything.

        And whether it need not be made again while it is believed.
        """
        base = self._mind.beliefs
        text, stays = belief_text(fact)
        since, known = base.since(fact)
        if not base.dated and self._whole and stays:
            since = new
        return mind_records.BeliefView(text=text, sources=sources_of(fact), since=since), stays and known


def intentions_of(mind: Mind) -> tuple[tuple[mind_records.IntentionView, ...], int]:
    """The intentions as they stand, and how many more there are."""
    shown = tuple(
        mind_records.IntentionView(
            id=view.id,
            state=view.state,
            waits_for=None if view.waits_for is None else mind_records.WaitView(**view.waits_for._asdict()),
            stack=tuple(goal.trigger for goal in view.stack[:MOST_GOALS]),
            at=view.stack[0].position if view.stack else "",
            since=view.since,
        )
        for view in mind.intention_views(MOST_INTENTIONS)
    )
    if len(shown) < MOST_INTENTIONS:
        return shown, 0
    return shown, sum(bool(intention.stack) for intention in mind.all_intentions()) - len(shown)


def events_of(mind: Mind, about: str) -> tuple[tuple[mind_records.EventView, ...], int]:
    """The events that are taken next, and how many more wait; those of another name are not shown."""
    views = mind.event_views(MOST_EVENTS)
    shown = [view for view in views if not about or view.name == about]
    return _records(shown, mind_records.EventView), len(mind.all_events()) - len(views)


def questions_of(mind: Mind, life: str) -> tuple[mind_records.QuestionView, ...]:
    """What others were asked and have not answered; the ids of messages end with `life` on the way."""
    views = mind.question_views()[:MOST_QUESTIONS]
    return _records((replace(view, id=f"{view.id}.{life}") for view in views), mind_records.QuestionView)


class Plans:
    """The plans of a mind as records, made anew when there are others."""

    def __init__(self, mind: Mind) -> None:
        self._mind = mind
        self._version = -1
        self._made: dict[str, tuple[mind_records.PlanView, ...]] = {}

    def shown(self, look: Look) -> tuple[mind_records.PlanView, ...]:
        """The plans in order, if they are asked for."""
        if not look.plans:
            return ()
        if self._version != self._mind.plans.version or len(self._made) > MOST_NAMES:
            self._version, self._made = self._mind.plans.version, {}
        made = self._made.get(look.about)
        if made is None:
            plans = (plan for plan in self._mind.plans if not look.about or _functor(plan) == look.about)
            made = self._made[look.about] = tuple(_plan(plan) for plan in islice(plans, MOST_LISTED_PLANS))
        return made


def _functor(plan: Any) -> Any:
    return getattr(plan.syntax.trigger.literal, "functor", None)


def _plan(plan: Any) -> mind_records.PlanView:
    shown = plan_view(plan)
    return mind_records.PlanView(
        label=shown.label,
        trigger=shown.trigger,
        position=shown.position,
        context=written(plan_context(plan.syntax)),
        uses=plan_uses(plan.syntax),
        source=source_text(plan.syntax),
    )


def decisions_of(
    mind: Mind, look: Look = EVERYTHING
) -> tuple[tuple[mind_records.DecisionView, ...], tuple[mind_records.FailureView, ...]]:
    """The last decisions and the failures among them. One whose outcome is known is made a record once."""
    recorder, most = mind.recorder, look.last
    if recorder is None or not most:
        return (), ()
    entries, known = recorder.entries(), recorder.shown
    wanted = [entry for entry in entries if is_about(record_of(entry), look.about)] if look.about else entries
    views: Views | None = None
    made: list[mind_records.DecisionView | mind_records.FailureView] = []
    for entry in wanted[-most:]:
        record = known[id(entry)][1] if id(entry) in known else None
        if record is None or (isinstance(record, mind_records.DecisionView) and record.outcome == "running"):
            if views is None:
                views = Views.among(mind, list(map(record_of, entries)))
            record = _seen_again(views, record_of(entry), record)
            known[id(entry)] = (entry, record)
        made.append(record)
    if len(known) > len(entries):
        here = set(map(id, entries))
        for gone in [identity for identity in known if identity not in here]:
            del known[gone]
    decisions = tuple(record for record in made if isinstance(record, mind_records.DecisionView))
    return decisions, tuple(record for record in made if isinstance(record, mind_records.FailureView))


def _seen_again(views: Views, record: Any, before: Any) -> mind_records.DecisionView | mind_records.FailureView:
    """A record as it is now; what it was at the last look, if it goes on as it did."""
    if before is not None and views.outcome(record) == before.outcome:
        known: mind_records.DecisionView = before
        return known
    view = views.of(record)
    if isinstance(view, DecisionView):
        return decision_record(view)
    return failure_record(view)


def decision_record(view: DecisionView) -> mind_records.DecisionView:
    """A decision as a record, with not too many plans."""
    failure = None if view.failure is None else failure_record(view.failure)
    return mind_records.DecisionView(
        cycle=view.cycle,
        time=view.time,
        event=view.event,
        kind=view.kind,
        name=view.name,
        source=view.source,
        intention=view.intention,
        goal=view.goal,
        cause=None if view.cause is None else _record(view.cause, mind_records.CauseView),
        asked_at=view.asked_at,
        rejected=tuple(map(_rejected, view.rejected[:MOST_PLANS])),
        chosen=None if view.chosen is None else _plan_record(view.chosen),
        untried=tuple(map(_plan_record, view.untried[:MOST_PLANS])),
        outcome=view.outcome,  # type: ignore[arg-type]
        failure=failure,
        dropped_by=view.dropped_by,
        dropped_at=view.dropped_at,
    )


def _rejected(view: RejectedView) -> mind_records.RejectedView:
    return mind_records.RejectedView(
        plan=_plan_record(view.plan),
        why=view.why,  # type: ignore[arg-type]
        literal=view.literal,
        filled=view.filled,
        message=view.message,
    )


def _plan_record(view: PlanView) -> mind_records.PlanView:
    return mind_records.PlanView(label=view.label, trigger=view.trigger, position=view.position, bindings=view.bindings)


def failure_record(view: FailureView) -> mind_records.FailureView:
    """A failure as a record."""
    record: mind_records.FailureView = _record(view, mind_records.FailureView)
    return record


def drops_of(mind: Mind) -> tuple[mind_records.DropView, ...]:
    """What was dropped because too much waited, by its name."""
    return _records(mind.drops.by_name, mind_records.DropView)


def _records(views: Iterable[Any], kind: type[V]) -> tuple[V, ...]:
    return tuple(_record(view, kind) for view in views)


def _record(view: Any, kind: type[Any]) -> Any:
    return msgspec.convert(view, kind, from_attributes=True)
