"""The internal actions behind the assertions of ``assertions.asl``; imported by ``agentd test`` alone."""

from __future__ import annotations

import itertools
import operator
import time
from collections.abc import Callable, Iterable
from typing import Any

from agentd.language.syntax_tree import nodes
from agentd.language.terms.format import text
from agentd.language.terms.from_ast import instantiate
from agentd.language.terms.terms import Collection, Literal, deref, elements, proper
from agentd.mind.beliefs.dynamic_formulas import same, solve
from agentd.mind.beliefs.term_copy import resolve, resolve_all
from agentd.mind.beliefs.unification import Trail, undo, unify
from agentd.mind.data.formula_failure import Failed, wrong_arguments
from agentd.mind.data.intention import ARGS, PLAN, RELEVANT, Intention, values_of
from agentd.mind.data.registry import internal_action
from agentd.mind.execution.intention_terms import calling_step
from agentd.mind.state import MindState
from agentd.testing.results import Asserted, TestEnded

FAILED = "assertion_failed"
"""Value of ``error(E)`` for an assertion that does not hold."""


def _assert(mind: MindState, held: bool, message: str) -> bool:
    """Report an assertion; one that does not hold fails its plan."""
    asserted = _asserted(mind.own_intention, "" if held else message)
    _report(mind, asserted)
    if not held:
        raise Failed(FAILED, message)
    return True


def _report(mind: MindState, effect: Asserted | TestEnded) -> None:
    """Emit an effect that only the runner of tests handles."""
    effects: list[Any] = mind.effects
    effects.append(effect)


def _asserted(intention: Intention, message: str) -> Asserted:
    stack = intention.stack
    own = stack[-1]
    goals = tuple(_goal(frame) for frame in reversed(stack[:-1]) if frame[RELEVANT].sig.functor != "agentd_run_test")
    step = calling_step(stack[-2], own) if len(stack) > 1 else None
    if step is None:
        return Asserted(message, f"!{text(Literal(own[RELEVANT].sig, resolve_all(own[ARGS])))}", "", 0, goals)
    assert isinstance(step.syntax, nodes.Step)
    formula = text(resolve(instantiate(step.syntax.term, dict(values_of(stack[-2])))))
    position = step.syntax.position
    return Asserted(message, f"{step.syntax.operator.value}{formula}", position.file, position.line, goals)


def _goal(frame: Any) -> str:
    relevant = frame[RELEVANT]
    goal = f"{relevant.text}{text(Literal(relevant.sig, resolve_all(frame[ARGS])))}"
    return f"{goal} ({frame[PLAN].syntax.position.file}:{frame[PLAN].syntax.position.line})"


def _shown(term: Any) -> str:
    return text(resolve(term))


@internal_action("agentd.test.equals", 2)
def equals(mind: MindState, trail: Trail, expected: Any, actual: Any) -> bool:
    """Equal as by ``==``: numbers by value, structures with their annotations; nothing is bound."""
    return _assert(mind, same(expected, actual), f"expected {_shown(expected)}, got {_shown(actual)}")


@internal_action("agentd.test.differs", 2)
def differs(mind: MindState, trail: Trail, unwanted: Any, actual: Any) -> bool:
    """Assert that ``==`` does not hold."""
    return _assert(mind, not same(unwanted, actual), f"expected anything but {_shown(unwanted)}")


@internal_action("agentd.test.close", 3)
def close(mind: MindState, trail: Trail, expected: Any, actual: Any, tolerance: Any) -> bool:
    """Two numbers that differ by no more than the tolerance."""
    values = [deref(term) for term in (expected, actual, tolerance)]
    shown = f"expected {_shown(expected)} within {_shown(tolerance)}, got {_shown(actual)}"
    if any(type(value) is not float for value in values):
        return _assert(mind, False, f"{shown}: only numbers have a distance")
    distance = abs(values[0] - values[1])
    held = values[0] == values[1] or distance <= values[2]
    return _assert(mind, held, f"{shown}, which is {_shown(distance)} away")


@internal_action("agentd.test.same_members", 2)
def same_members(mind: MindState, trail: Trail, expected: Any, actual: Any) -> bool:
    """Lists in which each member of one unifies with a member of the other."""
    lists = [proper(deref(term)) for term in (expected, actual)]
    shown = f"expected the members of {_shown(expected)}, got {_shown(actual)}"
    if lists[0] is None or lists[1] is None:
        return _assert(mind, False, f"{shown}: both must be lists")
    first, second = list(lists[0]), list(lists[1])
    held = all(_is_member(m, second, trail) for m in first) and all(_is_member(m, first, trail) for m in second)
    return _assert(mind, held, shown)


@internal_action("agentd.test.greater", 2)
def greater(mind: MindState, trail: Trail, number: Any, bound: Any) -> bool:
    """Assert that a number is above a bound."""
    return _compare(mind, f"expected {_shown(number)} > {_shown(bound)}", (bound, number), operator.lt)


@internal_action("agentd.test.at_least", 2)
def at_least(mind: MindState, trail: Trail, number: Any, bound: Any) -> bool:
    """Assert that a number is not below a bound."""
    return _compare(mind, f"expected {_shown(number)} >= {_shown(bound)}", (bound, number), operator.le)


@internal_action("agentd.test.between", 3)
def between(mind: MindState, trail: Trail, number: Any, lowest: Any, highest: Any) -> bool:
    """Assert that a number is in a range, its ends included."""
    shown = f"expected {_shown(lowest)} <= {_shown(number)} <= {_shown(highest)}"
    return _compare(mind, shown, (lowest, number, highest), operator.le)


def _compare(mind: MindState, shown: str, terms: tuple[Any, ...], in_order: Callable[[float, float], bool]) -> bool:
    values = [deref(term) for term in terms]
    if any(type(value) is not float for value in values):
        return _assert(mind, False, f"{shown}: only numbers have an order")
    return _assert(mind, all(itertools.starmap(in_order, itertools.pairwise(values))), shown)


@internal_action("agentd.test.clock", 1)
def clock(mind: MindState, trail: Trail, nanoseconds: Any) -> bool:
    """Real time: the mind's clock does not advance while a test computes."""
    return unify(nanoseconds, float(time.perf_counter_ns()), trail)


@internal_action("agentd.test.holds", 1)
def holds(mind: MindState, trail: Trail, formula: Any) -> bool:
    """Assert that a formula holds now."""
    return _assert(mind, _follows(mind, formula, trail), f"expected that {_shown(formula)} holds; it does not")


@internal_action("agentd.test.fails", 1)
def fails(mind: MindState, trail: Trail, formula: Any) -> bool:
    """Assert that a formula does not hold now."""
    return _assert(mind, not _follows(mind, formula, trail), f"expected that {_shown(formula)} does not hold; it does")


def _follows(mind: MindState, formula: Any, trail: Trail) -> bool:
    """Return whether a formula has a solution now."""
    mark = len(trail)
    found = any(True for _ in solve(mind, deref(formula), trail))
    undo(trail, mark)
    return found


@internal_action("agentd.test.contains", 2)
def contains(mind: MindState, trail: Trail, whole: Any, part: Any) -> bool:
    """A list, set or queue with a member that unifies, a map with a key, a string with a part."""
    held = _has(whole, part, trail)
    return _assert(mind, held, f"expected {_shown(part)} in {_shown(whole)}; it is not there")


@internal_action("agentd.test.lacks", 2)
def lacks(mind: MindState, trail: Trail, whole: Any, part: Any) -> bool:
    """Assert that `contains` does not hold."""
    held = not _has(whole, part, trail)
    return _assert(mind, held, f"expected no {_shown(part)} in {_shown(whole)}; it is there")


def _has(whole: Any, part: Any, trail: Trail) -> bool:
    container, member = deref(whole), deref(part)
    if type(container) is str:
        return (member if type(member) is str else text(resolve(member))) in container
    if type(container) is Collection:
        members = list(container.content)
    elif proper(container) is not None:
        members = list(elements(container))
    else:
        wrong_arguments("what contains something is a list, set, queue, map or string")
    return _is_member(member, members, trail)


def _is_member(term: Any, members: Iterable[Any], trail: Trail) -> bool:
    """Return whether a term unifies with one of the members; nothing is bound."""
    mark = len(trail)
    for each in members:
        fits = unify(term, each, trail)
        undo(trail, mark)
        if fits:
            return True
    return False


@internal_action("agentd.test.pass", 0)
def force_pass(mind: MindState, trail: Trail) -> bool:
    """Count an assertion that holds."""
    return _assert(mind, True, "")


@internal_action("agentd.test.fail", 1)
def force_failure(mind: MindState, trail: Trail, why: Any) -> bool:
    """Fail the test."""
    reason = deref(why)
    return _assert(mind, False, reason if type(reason) is str else _shown(reason))


@internal_action("agentd.test.ended", 0)
def ended(mind: MindState, trail: Trail) -> bool:
    """Report that the goal of the test was achieved."""
    _report(mind, TestEnded())
    return True


@internal_action("agentd.test.failed", 5)
def failed(mind: MindState, trail: Trail, error: Any, why: Any, formula: Any, line: Any, file: Any) -> bool:
    """Report that the goal of the test has failed."""
    reason, number, source = deref(why), deref(line), deref(file)
    _report(
        mind,
        TestEnded(
            _shown(error),
            reason if type(reason) is str else _shown(reason),
            _shown(formula),
            source if type(source) is str else _shown(source),
            int(number) if type(number) is float else 0,
        ),
    )
    return True
