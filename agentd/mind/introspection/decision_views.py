"""Decisions and failures as records of text for people, made from the decision log on demand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, TypeAlias
from typing import Literal as OneOf

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.printer import source_text
from agentd.language.terms.from_ast import instantiate
from agentd.language.terms.numbers import UndefinedNumber
from agentd.language.terms.source_annotations import SELF, is_source
from agentd.language.terms.terms import Code, Literal, Term, Var, deref
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.inputs import Mail
from agentd.mind.data.intention import ARGS, PLAN, RELEVANT, STEP, VARIABLES, Frame, Step
from agentd.mind.introspection.decision_log import Decision, Failure
from agentd.mind.introspection.snapshots import place, short_text
from agentd.mind.plans.plan_library import Plan, Relevant
from agentd.mind.state import MindState
from schemas.wire.mind_records import CauseView, DecisionView, FailureView, PlanView, RejectedView

Outcome: TypeAlias = OneOf["running", "ended", "failed", "dropped", "none"]

PASSED_OVER: Final = "passed over"
"""The reason why an applicable plan was not chosen: a selection function or rule took another."""


def is_about(record: Decision | Failure, functor: str) -> bool:
    """Return whether a record is about events or goals of this name."""
    if isinstance(record, Decision):
        return record.relevant.sig.functor == functor
    names = [frame[RELEVANT].sig.functor for frame in record.frames]
    return functor in names or (record.failed.goal is not None and record.failed.goal.sig.functor == functor)


def view_of(mind: MindState, record: Decision | Failure) -> DecisionView | FailureView:
    """Return the view of a record that has just been made."""
    alive = {id(record.frame)} if isinstance(record, Decision) else set()
    return Views(mind, (), alive).of(record)


class Views:
    """Makes views of records, with the outcomes of plans, given all the records that are remembered."""

    def __init__(self, mind: MindState, records: Sequence[Decision | Failure], alive: set[int] | None = None) -> None:
        """``alive`` are the identities of the frames of plans that run; None: they are looked for."""
        self._mind = mind
        self._failures = {id(frame): r for r in records if isinstance(r, Failure) for frame in r.frames}
        self._args = {id(r.frame): r.shown_args for r in records if isinstance(r, Decision) and r.frame is not None}
        if alive is None:
            alive = {id(frame) for intention in mind.all_intentions() for frame in intention.stack}
        self._alive = alive

    def outcome(self, made: Decision) -> Outcome:
        """Return the outcome of the chosen plan so far."""
        return self._outcome(made.frame)[0]

    def of(self, record: Decision | Failure) -> DecisionView | FailureView:
        """Return the view of a record."""
        return self._decision(record) if isinstance(record, Decision) else self._failure(record)

    def _decision(self, made: Decision) -> DecisionView:
        relevant, frame = made.relevant, made.frame
        outcome, failure = self._outcome(frame)
        recorder = self._mind.recorder
        dropped_by = recorder.dropped_by(frame)[1] if recorder and frame and outcome == "dropped" else None
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

    def _outcome(self, frame: Frame | None) -> tuple[Outcome, Failure | None]:
        if frame is None:
            return "none", None
        failure = self._failures.get(id(frame))
        if failure is not None:
            return "failed", failure
        if id(frame) in self._alive:
            return "running", None
        recorder = self._mind.recorder
        dropped = frame[STEP] is not None or (recorder is not None and recorder.dropped_by(frame)[0])
        return ("dropped" if dropped else "ended"), None

    def _goal(self, frame: Frame) -> str:
        """Return the event that a frame is for, as it was when its plan was chosen."""
        return event_text(frame[RELEVANT], self._args.get(id(frame)) or frame[ARGS])

    def _cause(self, made: Decision) -> CauseView | None:
        if made.below is not None:
            failed = made.relevant.operator == "-" and made.relevant.goal
            return CauseView(kind="failure" if failed else "plan", intention=made.intention)
        origin = made.origin
        if made.asked is not None:
            return CauseView(kind="intention", intention=made.intention)
        if origin is not None and isinstance(origin[0], Mail):
            mail = origin[0]
            return CauseView(kind="message", sender=mail.sender, performative=mail.performative, message=mail.msg_id)
        sources = [a.args[0] for a in made.annots if is_source(a)]
        if (origin is not None and made.annots is SELF) or not sources:
            if origin is None:
                return None
            if origin[0] is not None:
                return CauseView(kind="outside")
            return CauseView(kind="intention", intention=origin[1]) if origin[1] else CauseView(kind="program")
        match ", ".join(map(short_text, sources)):
            case "percept":
                return CauseView(kind="percept")
            case "self":
                return None
            case names:
                return CauseView(kind="told", sender=names)

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
            reason=record.failed.message,
            given_up=given_up,
            handled_by="" if handler is None else repr(handler),
        )


def event_text(relevant: Relevant, args: tuple[Term, ...], annots: tuple[Term, ...] = ()) -> str:
    """Return an event as text, ``+!g(1)``, without the source ``self``."""
    shown = () if annots == SELF else annots
    return f"{relevant.text}" + short_text(Literal(relevant.sig, args, shown))


def rejected_view(plan: Plan, reason: Any) -> RejectedView:
    """Return why a plan was not applicable; ``reason`` is what its function returned or raised, () if unknown."""
    if reason is None:
        annotated = getattr(plan.syntax.trigger.literal, "annotations", None) is not None
        message = f"its trigger {'and annotations do' if annotated else 'does'} not match"
        return RejectedView(plan=plan_view(plan), why="trigger", message=message)
    if reason is PASSED_OVER:
        return RejectedView(plan=plan_view(plan), why="choice", message="it is applicable, but was not chosen")
    if reason == ():
        return RejectedView(plan=plan_view(plan), why="context", message="its context does not hold")
    if isinstance(reason, Exception):
        what = "it is too deep" if isinstance(reason, RecursionError) else str(reason) or type(reason).__name__
        return RejectedView(plan=plan_view(plan), why="error", message=f"its context cannot be computed: {what}")
    number, values = reason
    node, names = plan.tried[number]
    bindings = dict(zip(names, values, strict=True))
    literal = plan.tried_texts.get(number)
    if literal is None:
        literal = plan.tried_texts[number] = written(source_text(node))
    filled = filled_text(node, bindings)
    shown = {name: short_text(value) for name, value in bindings.items() if type(deref(value)) is not Var}
    message = f"{filled} does not hold" if shown else f"{literal} does not hold"
    return RejectedView(plan=plan_view(plan, shown), why="context", literal=literal, filled=filled, message=message)


def filled_text(node: nodes.Term, bindings: dict[str, Any]) -> str:
    """Return a formula with the values of its variables put in."""
    try:
        return written(short_text(instantiate(node, dict(bindings))))
    except (UndefinedNumber, RecursionError):
        return written(source_text(node))


def written(text: str) -> str:
    """Return a formula without brackets around the whole of it, or around the operand of ``not``."""
    if text.startswith("not ("):
        return f"not {_unbracketed(text[4:])}"
    return _unbracketed(text)


def _unbracketed(text: str) -> str:
    if not (text.startswith("(") and text.endswith(")")):
        return text
    depth = 0
    for at, character in enumerate(text):
        depth += (character == "(") - (character == ")")
        if depth == 0:
            return text[1:-1] if at == len(text) - 1 else text
    return text


def plan_view(plan: Plan, bindings: dict[str, str] | None = None) -> PlanView:
    """Return a plan for people. Its texts are made once: they never change."""
    texts: tuple[str, str, str] | None = plan.shown
    if texts is None:
        node = plan.syntax
        written_label = source_text(node.label) if node.label is not None else ""
        texts = (written_label, source_text(node.trigger), place(node.position))
        plan.shown = texts
    label, trigger, position = texts
    return PlanView(label=label, trigger=trigger, position=position, bindings=bindings or {})


def _values(frame: Frame, values: tuple[Term, ...] | None) -> dict[str, str]:
    """Return the variables that had a value when a plan was chosen."""
    plan: Plan = frame[PLAN]
    places = frame[VARIABLES:] if values is None else values
    found = {name: places[plan.slots[name] - VARIABLES] for name in plan.bound}
    return {name: short_text(value) for name, value in found.items() if type(deref(value)) is not Var}


def _place(step: Step | None) -> str:
    return "" if step is None else place(step.syntax.position)


def what_failed(failed: Failed, code: Any) -> str:
    """Return the formula that failed with its values, or the goal that found no plan."""
    if failed.goal is not None:
        return event_text(failed.goal, code.args, code.annots)
    if failed.step is None or type(code) is Code or not isinstance(failed.step.syntax, nodes.Step):
        return short_text(code)
    operator: str = failed.step.syntax.operator.value
    return operator + short_text(code)
