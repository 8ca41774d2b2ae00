"""What a mind shows of itself to observers, as records."""

from __future__ import annotations

from typing import Any, Final

import msgspec

from agentd.mind import Mind
from agentd.mind.decision_views import DecisionView, FailureView
from schemas import minds

LAST_DECISIONS: Final = 20
"""So many of the last decisions and failures stand in a view of a mind."""
MOST_PLANS: Final = 10
"""So many plans of a decision are shown."""


def intentions_of(mind: Mind) -> tuple[minds.IntentionView, ...]:
    """The intentions as they stand."""
    return tuple(
        minds.IntentionView(
            id=view.id,
            state=view.state,
            reason=view.reason,
            stack=tuple(goal.trigger for goal in view.stack),
            at=view.stack[0].position if view.stack else "",
        )
        for view in mind.intention_views()
    )


def decisions_of(mind: Mind) -> tuple[tuple[minds.DecisionView, ...], tuple[minds.FailureView, ...]]:
    """The last decisions and the failures among them."""
    views = mind.decision_views(LAST_DECISIONS)
    decisions = tuple(_decision(view) for view in views if isinstance(view, DecisionView))
    return decisions, tuple(_record(view, minds.FailureView) for view in views if isinstance(view, FailureView))


def _decision(view: DecisionView) -> minds.DecisionView:
    record: minds.DecisionView = _record(view, minds.DecisionView)
    if len(record.rejected) <= MOST_PLANS and len(record.untried) <= MOST_PLANS:
        return record
    return msgspec.structs.replace(record, rejected=record.rejected[:MOST_PLANS], untried=record.untried[:MOST_PLANS])


def _record(view: Any, kind: type[Any]) -> Any:
    return msgspec.convert(view, kind, from_attributes=True)
