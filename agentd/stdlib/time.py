"""Time, waiting, and events at a later time."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from typing import Any

from agentd.language.terms.terms import Code, Expression, Literal, Term, deref
from agentd.mind.beliefs.dynamic_formulas import solve
from agentd.mind.beliefs.term_copy import detach, resolve_all
from agentd.mind.beliefs.unification import Trail, unify
from agentd.mind.data.formula_failure import Failed, wrong_arguments
from agentd.mind.data.intention import Frame, Intention
from agentd.mind.data.registry import function, internal_action
from agentd.mind.execution.waiting import milliseconds, signal, wait_event, wait_time, wait_until
from agentd.mind.plans.plan_terms import read_trigger, trigger_literal
from agentd.mind.state import MindState


@internal_action(".wait", (1, 3), suspends=True)
def wait(
    mind: MindState, trail: Trail, what: Term, limit: Term | None = None, elapsed: Term | None = None
) -> bool | None:
    """``.wait(Ms)``, ``.wait({event}[, Ms[, Elapsed]])``, ``.wait(Formula[, Ms[, Elapsed]])``: waits.

    After Ms milliseconds without the event or formula it fails, or continues if Elapsed, the time in ms, is given.
    """
    intention = mind.own_intention
    term = deref(what)
    if type(term) is float:
        return wait_time(mind, intention, milliseconds(term))
    if type(term) is Code:
        return wait_event(mind, intention, term, limit, elapsed)
    if type(term) is str:
        return wait_event(mind, intention, read_trigger(mind, term), limit, elapsed)
    if type(term) in (Literal, Expression):

        def check(mind: MindState, intention: Intention, frame: Frame) -> bool:
            return any(True for _ in solve(mind, term, intention.trail))

        return wait_until(mind, intention, intention.stack[-1], check, limit, elapsed)
    return wrong_arguments(".wait takes a time in milliseconds, a formula or an event in braces")


_AT = re.compile(r"\s*now\s*(?:\+\s*(\d+(?:\.\d+)?)\s*([a-z]*))?\s*$")
_UNITS = {
    unit: seconds
    for units, seconds in (
        ("ms millisecond milliseconds", 0.001),
        ("s second seconds", 1.0),
        ("m minute minutes", 60.0),
        ("h hour hours", 3600.0),
        ("d day days", 86400.0),
    )
    for unit in units.split()
}
"""The seconds of each unit of ``.at``."""


@internal_action(".at", 2)
def at(mind: MindState, trail: Trail, when: Any, trigger: Term) -> bool:
    """``.at("now +N unit", {trigger})``: raises the event then; it carries no source.

    Units are ``ms``, ``s``, ``minutes``, ``hours`` and ``days``.
    """
    written = deref(when)
    match = _AT.match(written) if type(written) is str else None
    if match is None or (match.group(2) or "ms") not in _UNITS:
        raise Failed("internal_action", f"the time '{written}' is not of the form \"now +N seconds\"")
    code = read_trigger(mind, trigger)
    literal = trigger_literal(code)
    relevant = mind.plans.relevant(code.syntax.operator, code.syntax.goal, literal.sig)
    args, annots = detach(resolve_all(literal.args)), resolve_all(literal.annots)
    delay = float(match.group(1) or 0) * _UNITS[match.group(2) or "ms"]

    def due() -> None:
        mind.future_events.remove(timer)
        signal(mind, relevant, args, annots)

    timer = mind.timers.at(mind.now + delay, due)
    mind.future_events.append(timer)
    return True


def _clock(mind: MindState) -> datetime:
    return datetime.fromtimestamp(mind.epoch + mind.read_clock(), UTC).astimezone(mind.zone)


@internal_action(".date", 3)
def date(mind: MindState, trail: Trail, year: Any, month: Any, day: Any) -> bool:
    """``.date(Year, Month, Day)``: today, by mission time."""
    now = _clock(mind)
    parts = ((year, now.year), (month, now.month), (day, now.day))
    return all(unify(term, float(number), trail) for term, number in parts)


@internal_action(".time", (3, 4))
def time(mind: MindState, trail: Trail, hour: Any, minute: Any, second: Term, millisecond: Any = None) -> bool:
    """``.time(Hour, Minute, Second[, Millisecond])``: now, by mission time."""
    now = _clock(mind)
    parts = [(hour, now.hour), (minute, now.minute), (second, now.second)]
    if millisecond is not None:
        parts.append((millisecond, now.microsecond // 1000))
    return all(unify(term, float(number), trail) for term, number in parts)


@internal_action(".nano_time", 1)
def nano_time(mind: MindState, trail: Trail, result: Term) -> bool:
    """``.nano_time(T)``: nanoseconds of mission time."""
    return unify(result, float(round(mind.read_clock() * 1e9)), trail)


@function("system.time", 0)
def system_time(mind: MindState) -> float:
    """``system.time``: milliseconds since the epoch, by mission time."""
    return float(int((mind.epoch + mind.read_clock()) * 1000))
