"""What a mind shows of its decisions: plain facts as text, made from the records when somebody asks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.printer import source_text
from agentd.language.terms.from_ast import instantiate
from agentd.language.terms.numbers import UndefinedNumber
from agentd.language.terms.source_annotations import SELF, is_source
from agentd.language.terms.terms import Code, Literal, Var, deref
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.inputs import Mail
from agentd.mind.data.intention import ARGS, PLAN, RELEVANT, STEP, VARIABLES, Frame, Step
from agentd.mind.introspection.decision_log import Decision, Failure
from agentd.mind.introspection.term_snapshot import short_text
from agentd.mind.plans.plan_library import Plan, Relevant
from agentd.mind.state import MindState

PASSED_OVER: Final = "passed over"
"""The reason why an applicable plan was not chosen: a selection function or rule took another."""


@dataclass(frozen=True, slots=True)
class PlanView:
    """A plan: its label as written (empty if it has none), its trigger, ``file:line``, and variables with values."""

    label: str
    trigger: str
    position: str
    bindings: dict[str, str]


@dataclass(frozen=True, slots=True)
class RejectedView:
    """A plan that was tried in vain.

    ``why`` is ``trigger`` (it does not unify with the event), ``context``, ``error`` (the context could not be
    computed) or ``choice`` (it was applicable, but a selection function or rule did not choose it). For
    ``context``, ``literal`` is the part that failed as written and ``filled`` the same with the values that its
    variables had; these are the plan's ``bindings``. ``message`` says it in words.
    """

    plan: PlanView
    why: str
    literal: str
    filled: str
    message: str


@dataclass(frozen=True, slots=True)
class FailureView:
    """A formula that failed, or a goal without a plan.

    ``formula`` has its values put in; ``error`` is what ``error(E)`` shows and ``reason`` why, in words. ``given_up``
    are the goals that ended with it, innermost first; ``handled_by`` is the event ``-!g`` that goes on from here, empty
    if nothing does.
    """

    cycle: int
    time: float
    intention: int
    formula: str
    position: str
    error: str
    reason: str
    given_up: tuple[str, ...]
    handled_by: str


@dataclass(frozen=True, slots=True)
class CauseView:
    """Where an event comes from; the fields are those of `schemas.wire.mind_records.CauseView`."""

    kind: str
    intention: int = 0
    sender: str = ""
    performative: str = ""
    message: str = ""


@dataclass(frozen=True, slots=True)
class DecisionView:
    """An event and the plan that was chosen for it.

    ``kind`` is the operator and kind of the event, such as ``+!``, ``name`` its functor and arity. ``goal`` is the
    event of the plan that raised it and waits for it, if any. ``cause`` is None for the agent itself; ``asked_at`` is
    the ``file:line`` of the formula that raised it. ``rejected`` are the plans tried before the chosen one, ``untried``
    those after it. ``outcome`` says what became of the chosen plan so far: ``running``, ``ended``, ``failed``,
    ``dropped``, or ``none`` where no plan was chosen; ``failure`` what failed in it; ``dropped_by`` the formula that
    dropped it, at ``dropped_at``, its ``file:line``.
    """

    cycle: int
    time: float
    event: str
    kind: str
    name: str
    source: str
    intention: int
    goal: str
    cause: CauseView | None
    asked_at: str
    rejected: tuple[RejectedView, ...]
    chosen: PlanView | None
    untried: tuple[PlanView, ...]
    outcome: str
    failure: FailureView | None
    dropped_by: str = ""
    dropped_at: str = ""


def views_of(
    mind: MindState, records: Sequence[Decision | Failure], last: int | None, about: str = ""
) -> list[DecisionView | FailureView]:
    """Views of records; of a long list only the last so many, of those ``about`` a functor if one is given."""
    views = Views.among(mind, records)
    if about:
        records = [record for record in records if is_about(record, about)]
    return [views.of(record) for record in (records if last is None else records[max(0, len(records) - last) :])]


def is_about(record: Decision | Failure, functor: str) -> bool:
    """Whether a record is about events or goals of this name."""
    if type(record) is Decision:
        return bool(record.relevant.sig.functor == functor)
    goal = record.failed.goal  # type: ignore[union-attr]
    names = [frame[RELEVANT].sig.functor for frame in record.frames]  # type: ignore[union-attr]
    return functor in names or (goal is not None and goal.sig.functor == functor)


def view_of(mind: MindState, record: Decision | Failure) -> DecisionView | FailureView:
    """The view of a record that has just been made."""
    alive = {id(record.frame)} if isinstance(record, Decision) else set()
    return Views(mind, {}, {}, alive).of(record)


class Views:
    """Makes views; knows what became of frames."""

    @classmethod
    def among(cls, mind: MindState, records: Sequence[Decision | Failure]) -> Views:
        """What makes views of records, all that are remembered being these."""
        failures = {id(frame): record for record in records if type(record) is Failure for frame in record.frames}
        args = {id(r.frame): r.shown_args for r in records if isinstance(r, Decision) and r.frame is not None}
        alive = {id(frame) for intention in mind.all_intentions() for frame in intention.stack}
        return cls(mind, failures, args, alive)

    def __init__(
        self, mind: MindState, failures: dict[int, Failure], args: dict[int, tuple[Any, ...]], alive: set[int]
    ) -> None:
        self._mind, self._failures, self._args, self._alive = mind, failures, args, alive

    def outcome(self, made: Decision) -> str:
        """What became of the chosen plan so far."""
        return self._outcome(made.frame)[0]

    def of(self, record: Decision | Failure) -> DecisionView | FailureView:
        """The view of a record."""
        return self._decision(record) if isinstance(record, Decision) else self._failure(record)

    def _decision(self, made: Decision) -> DecisionView:
        relevant, frame = made.relevant, made.frame
        outcome, failure = self._outcome(frame)
        recorder = self._mind.recorder
        dropped_by = recorder.dropped_by(frame) if recorder and frame and outcome == "dropped" else None
        plans: list[Plan] = relevant.plans
        chosen = None if frame is None else frame[PLAN]
        after = plans[plans.index(chosen) + 1 :] if chosen in plans else []
        return DecisionView(
            cycle=made.cycle,
            time=made.time,
            event=event_text(relevant, made.shown_args, made.annots),
            kind=relevant.text,
            name=relevant.sig.indicator,
            source=", ".join(short_text(a.args[0]) for a in made.annots if is_source(a)),
            intention=made.intention,
            goal="" if made.below is None else self._goal(made.below),
            cause=self._cause(made),
            asked_at=_place(made.asked or (made.origin[2] if made.origin is not None else None)),
            rejected=tuple(rejected_view(plan, reason) for plan, reason in made.rejected or ()),
            chosen=None if frame is None else plan_view(frame[PLAN], _values(frame, made.values)),
            untried=tuple(plan_view(plan) for plan in after),
            outcome=outcome,
            failure=None if failure is None else self._failure(failure),
            dropped_by="" if dropped_by is None else source_text(dropped_by.syntax),
            dropped_at=_place(dropped_by),
        )

    def _outcome(self, frame: Frame | None) -> tuple[str, Failure | None]:
        if frame is None:
            return "none", None
        failure = self._failures.get(id(frame))
        if failure is not None:
            return "failed", failure
        if id(frame) in self._alive:
            return "running", None
        recorder = self._mind.recorder
        dropped = frame[STEP] is not None or (recorder is not None and recorder.was_dropped(frame))
        return ("dropped" if dropped else "ended"), None

    def _goal(self, frame: Frame) -> str:
        """The event that a frame is for, as it was when its plan was chosen."""
        return event_text(frame[RELEVANT], self._args.get(id(frame)) or frame[ARGS])

    def _cause(self, made: Decision) -> CauseView | None:
        if made.below is not None:
            failed = made.relevant.operator == "-" and made.relevant.goal
            return CauseView("failure" if failed else "plan", made.intention)
        origin = made.origin
        if made.asked is not None:
            return CauseView("intention", made.intention)
        if origin is not None and isinstance(origin[0], Mail):
            mail = origin[0]
            return CauseView("message", sender=mail.sender, performative=mail.performative, message=mail.msg_id)
        sources = [a.args[0] for a in made.annots if is_source(a)]
        if (origin is not None and made.annots is SELF) or not sources:
            if origin is None:
                return None
            if origin[0] is not None:
                return CauseView("outside")
            return CauseView("intention", origin[1]) if origin[1] else CauseView("program")
        match ", ".join(map(short_text, sources)):
            case "percept":
                return CauseView("percept")
            case "self":
                return None
            case names:
                return CauseView("told", sender=names)

    def _failure(self, record: Failure) -> FailureView:
        handler = record.handler
        given_up = tuple(self._goal(frame) for frame in record.frames)
        return FailureView(
            cycle=record.cycle,
            time=record.time,
            intention=record.intention,
            formula=what_failed(record.failed, record.code),
            position=_place(record.failed.step),
            error=record.failed.error,
            reason=reason_of(record.failed),
            given_up=given_up,
            handled_by="" if handler is None else repr(handler),
        )


def event_text(relevant: Relevant, args: tuple[Any, ...], annots: tuple[Any, ...] = ()) -> str:
    """An event as people write it, ``+!g(1)``; the source ``self`` goes without saying."""
    shown = () if annots == SELF else annots
    return f"{relevant.text}" + short_text(Literal(relevant.sig, args, shown))


def rejected_view(plan: Plan, reason: Any) -> RejectedView:
    """Why a plan was not applicable, from what its function returned or raised; () if that is unknown."""
    if reason is None:
        annotated = getattr(plan.syntax.trigger.literal, "annotations", None) is not None
        message = f"its trigger {'and annotations do' if annotated else 'does'} not match"
        return RejectedView(plan_view(plan), "trigger", "", "", message)
    if reason is PASSED_OVER:
        return RejectedView(plan_view(plan), "choice", "", "", "it is applicable, but was not chosen")
    if reason == ():
        return RejectedView(plan_view(plan), "context", "", "", "its context does not hold")
    if isinstance(reason, Exception):
        what = "it is too deep" if isinstance(reason, RecursionError) else str(reason) or type(reason).__name__
        return RejectedView(plan_view(plan), "error", "", "", f"its context cannot be computed: {what}")
    number, values = reason
    node, names = plan.tried[number]
    bindings = dict(zip(names, values, strict=True))
    literal = plan.tried_texts.get(number)
    if literal is None:
        literal = plan.tried_texts[number] = written(source_text(node))
    filled = filled_text(node, bindings)
    shown = {name: short_text(value) for name, value in bindings.items() if type(deref(value)) is not Var}
    message = f"{filled} does not hold" if shown else f"{literal} does not hold"
    return RejectedView(plan_view(plan, shown), "context", literal, filled, message)


def filled_text(node: nodes.Term, bindings: dict[str, Any]) -> str:
    """A formula with the values of its variables put in."""
    try:
        return written(short_text(instantiate(node, dict(bindings))))
    except (UndefinedNumber, RecursionError):
        return written(source_text(node))


def written(text: str) -> str:
    """A formula as people write it: without brackets around all of it, or around what ``not`` is for."""
    if text.startswith("not ("):
        return f"not {_unbracketed(text[4:])}"
    return _unbracketed(text)


def _unbracketed(text: str) -> str:
    if not (text.startswith("(") and text.endswith(")")):
        return text
    depth = 0
    for place, character in enumerate(text):
        depth += (character == "(") - (character == ")")
        if depth == 0:
            return text[1:-1] if place == len(text) - 1 else text
    return text


def plan_view(plan: Any, bindings: dict[str, str] | None = None) -> PlanView:
    """A plan for people. Its texts are made once: they never change."""
    texts: tuple[str, str, str] | None = plan.shown
    if texts is None:
        node = plan.syntax
        written_label = source_text(node.label) if node.label is not None else ""
        texts = (written_label, source_text(node.trigger), f"{node.position.file}:{node.position.line}")
        plan.shown = texts
    label, trigger, position = texts
    return PlanView(label, trigger, position, bindings or {})


def _values(frame: Frame, values: tuple[Any, ...] | None) -> dict[str, str]:
    """The variables that had a value when a plan was chosen."""
    plan: Plan = frame[PLAN]
    places = frame[VARIABLES:] if values is None else values
    found = {name: places[plan.slots[name] - VARIABLES] for name in plan.bound}
    return {name: short_text(value) for name, value in found.items() if type(deref(value)) is not Var}


def _place(step: Step | None) -> str:
    return "" if step is None else f"{step.syntax.position.file}:{step.syntax.position.line}"


def failed_text(step: Step | None, code: Any) -> str:
    """A formula that failed, as written but with its values."""
    if step is None or type(code) is Code or not isinstance(step.syntax, nodes.Step):
        return short_text(code)
    return step.syntax.operator.value + short_text(code)


def what_failed(failed: Failed, code: Any) -> str:
    """The formula that failed with its values, or the goal that found no plan."""
    if failed.goal is None:
        return failed_text(failed.step, code)
    return event_text(failed.goal, code.args, code.annots)


def reason_of(failed: Failed) -> str:
    """Why something failed, in words; empty where there is no more to say than the name of the error."""
    return str(failed) if str(failed) != failed.error else ""
