"""The decisions and failures that an agent remembers, and which of them caused which."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from argosy.why.wording import without_annotations
from schemas.wire.mind_records import DecisionView, FailureView, MindView, PlanView


@dataclass(frozen=True)
class Cause:
    """Cause of an event: the decision whose plan raised it, or the failure that it is about, if remembered."""

    by: DecisionView | None = None
    failure: FailureView | None = None
    own_focus: bool = False
    """It began an intention of its own, for which no plan waits."""


class Memory:
    """The decisions and failures that a view of a mind holds."""

    def __init__(self, view: MindView) -> None:
        self.view = view
        self.decisions, self.failures = view.decisions, view.failures
        self._place = {id(decision): number for number, decision in enumerate(view.decisions)}

    @property
    def now(self) -> float:
        """Mission seconds of the view."""
        times = [one.time for one in self.decisions[-1:]] + [one.time for one in self.failures[-1:]]
        return max([self.view.time, *times])

    def cause(self, decision: DecisionView) -> Cause:
        """Return the cause of a decision."""
        failure = self._failure_before(decision) if decision.kind.startswith("-") and "!" in decision.kind else None
        if failure is not None:
            goal = failure.given_up[-1] if failure.given_up else decision.goal
            return Cause(self._latest(decision, failure.intention, goal), failure)
        if decision.goal:
            return Cause(self._latest(decision, decision.intention, decision.goal))
        if decision.cause is not None and decision.cause.kind == "intention":
            return Cause(self._raiser(decision, decision.cause.intention), own_focus=True)
        return Cause()

    def chain(self, decision: DecisionView) -> Iterator[tuple[DecisionView, Cause]]:
        """Yield a decision and those that led to it, each with its cause."""
        seen: set[int] = set()
        current: DecisionView | None = decision
        while current is not None and id(current) not in seen:
            seen.add(id(current))
            cause = self.cause(current)
            yield current, cause
            current = cause.by

    def led_to(self, failure: FailureView) -> DecisionView | None:
        """Return the decision for the event that handles a failure."""
        if not failure.handled_by:
            return None
        for decision in self.decisions:
            if decision.cycle >= failure.cycle and decision.kind.startswith("-"):
                found = self._failure_before(decision)
                if found is not None and _identity(found) == _identity(failure):
                    return decision
        return None

    def outcome_of(self, failure: FailureView) -> DecisionView | None:
        """Return the decision whose plan had this failure."""
        return next((one for one in reversed(self.decisions) if one.failure == failure), None)

    def _before(self, decision: DecisionView) -> Iterator[DecisionView]:
        place = self._place.get(id(decision), len(self.decisions))
        return (self.decisions[number] for number in range(place - 1, -1, -1))

    def _latest(self, decision: DecisionView, intention: int, event: str) -> DecisionView | None:
        """Return the last decision before another one, for an event of an intention."""
        return next(
            (
                one
                for one in self._before(decision)
                if one.intention == intention and one.chosen and without_annotations(one.event) == event
            ),
            None,
        )

    def _raiser(self, decision: DecisionView, intention: int) -> DecisionView | None:
        """Return the decision for the plan of an intention that raised an event."""
        plan = self.plan_at(decision.asked_at)
        found = (one for one in self._before(decision) if one.intention == intention and one.chosen)
        return next((o for o in found if plan is None or (o.chosen and o.chosen.position == plan.position)), None)

    def plan_at(self, position: str) -> PlanView | None:
        """Return the plan whose body has a formula at `file:line`."""
        file, line = _place(position)
        best: PlanView | None = None
        for plan in (*self.view.plans, *(one.chosen for one in self.decisions if one.chosen)):
            its_file, begins = _place(plan.position)
            if its_file == file and begins <= line and (best is None or begins >= _place(best.position)[1]):
                best = plan
        return best

    def _failure_before(self, decision: DecisionView) -> FailureView | None:
        """Return the failure that triggered a failure plan."""
        for failure in reversed(self.failures):
            later = failure.cycle <= decision.cycle and failure.intention in (decision.intention, 0)
            if later and failure.handled_by == f"{decision.kind}{decision.name}":
                return failure
        return None


def _identity(failure: FailureView) -> tuple[int, int, str]:
    return failure.cycle, failure.intention, failure.formula


def _place(position: str) -> tuple[str, int]:
    file, _, line = position.rpartition(":")
    return file, int(line) if line.isdigit() else 0
