"""Selection functions and rules: choose the next message, event, option and intention in place of the defaults.

The defaults are Jason's: the oldest message, the oldest event, the first applicable plan in file order, intentions in
turn. A function of the embedder, ``select_message``, ``select_event``, ``select_option`` or ``select_intention``, takes
the mind and the candidates and returns one of them, or None for none in this cycle (for options: no plan is
applicable). A mind without selection functions runs none of this.

The options of an event are the relevant plans whose context holds, in file order (nested plans in sight first), each
with its bindings. The function gets them all. A program may choose by a rule ``select__option(E,I,P,U)`` instead. It is
asked for one option after the other, with all solutions of a context, and the first for which it holds is taken: E is
the event as a trigger term, I ``intention(Id, Stack)`` as ``.intention`` shows stacks (or ``none``), P the plan as a
term, U a list of ``map(Name, Value)``. If it holds for none, no plan is applicable.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Final

from msgspec import Struct

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.terms import Code, Literal, Term, Var, atom, deref, make_list
from agentd.mind.beliefs.term_copy import resolve, resolve_all
from agentd.mind.beliefs.unification import Trail, undo, unify
from agentd.mind.data.intention import Event, Frame
from agentd.mind.execution.intention_terms import stack_of
from agentd.mind.introspection.decision_views import PASSED_OVER
from agentd.mind.introspection.failure_text import context_failed
from agentd.mind.introspection.snapshots import held_all
from agentd.mind.plans.nested_plans import candidates
from agentd.mind.plans.plan_library import Plan, Select
from agentd.mind.plans.plan_terms import term_of
from agentd.mind.state import MindState

Selector = Callable[[MindState, Sequence[Any]], Any]

PATIENCE: Final = 1000
"""Consecutive cycles in which a selection function may choose nothing before a warning."""


class WaitingEvent(Struct, frozen=True):
    """An event that waits.

    ``kind`` is ``+``, ``-``, ``+!``, ``-!``, ``+?`` or ``-?``, ``literal`` what it is about with its annotations,
    ``intention`` the id of the intention that waits for it (0: it is to begin one).
    """

    kind: str
    literal: Literal
    intention: int

    @staticmethod
    def of(event: Event) -> WaitingEvent:
        """Return the view of an event of the queue."""
        relevant, args, annots, intention = event
        literal = Literal(relevant.sig, resolve_all(args), resolve_all(annots))
        return WaitingEvent(relevant.text, literal, 0 if intention is None else intention.id)


class Chooser:
    """The turns of a mind that has selection functions."""

    def __init__(self, mind: MindState, selectors: dict[str, Selector]) -> None:
        self._mind = mind
        self._message, self._event = selectors.get("select_message"), selectors.get("select_event")
        self._intention = selectors.get("select_intention")
        self._idle: dict[str, int] = {}

    def message(self) -> bool:
        """Move the message that its function chooses to the front."""
        return self._move(self._mind.mailbox, self._message, "select_message", _itself)

    def event(self) -> bool:
        """Move the event that its function chooses to the front."""
        return self._move(self._mind.events, self._event, "select_event", WaitingEvent.of)

    def intention(self) -> bool:
        """Move the intention that its function chooses to the front, unless an atomic plan has just begun."""
        mind = self._mind
        if not mind.running or mind.atomic is not None:
            return False
        return self._move(mind.running, self._intention, "select_intention", _itself)

    def over(self) -> bool:
        """Return whether there is nothing to choose from."""
        mind = self._mind
        if mind.running and mind.atomic is None:
            return False
        return not (mind.events or mind.inputs or mind.mailbox)

    def _move(self, queue: deque[Any], selector: Selector | None, name: str, view: Callable[[Any], Any]) -> bool:
        """Move the item that a selection function chooses to the front of its queue; False if it chooses nothing."""
        if selector is None:
            return True
        place = choose(self._mind, selector, name, [view(item) for item in queue])
        if place is None:
            self._idle[name] = self._idle.get(name, 0) + 1
            if self._idle[name] == PATIENCE:
                self._mind.warn_once(f"{name} has chosen none of {len(queue)} for {PATIENCE} cycles")
            return False
        self._idle[name] = 0
        item = queue[place]
        del queue[place]
        queue.appendleft(item)
        return True


def choose(mind: MindState, selector: Selector, name: str, items: Sequence[Any]) -> int | None:
    """Return the index that a selection function chooses, None for none; on a wrong answer 0, and a warning."""
    try:
        chosen = selector(mind, tuple(items))
    except Exception as error:  # the embedder's code may raise anything; it must not end the mind
        mind.warn_once(f"{name} raised {type(error).__name__}: {error}; the default is used instead")
        return 0
    if chosen is None:
        return None
    for place, item in enumerate(items):
        if item is chosen:
            return place
    what = f"one of the {len(items)} that it was given, or None"
    mind.warn_once(f"{name} must return {what}, not {chosen!r:.80}; the default is used instead")
    return 0


def _itself(item: Any) -> Any:
    return item


NAMES: Final = ("select_message", "select_event", "select_option", "select_intention")


def selectors_of(mind: MindState, given: Sequence[Selector | None]) -> dict[str, Selector]:
    """Return the selection functions of a mind by name: those given, else the methods of its class with these names."""
    found = {name: each or getattr(type(mind), name, None) for name, each in zip(NAMES, given, strict=True)}
    return {name: selector for name, selector in found.items() if selector is not None}


# --- options ---


RULE: Final = signature("select__option", 4)
"""The rule by which a program chooses among options."""

_MAP, _INTENTION = signature("map", 2), signature("intention", 2)
_ALL: Final = signature("all_unifs")


class Option(Struct, frozen=True):
    """A way in which a plan is applicable to an event.

    ``plan`` has its ``label`` (a literal with annotations) and its ``syntax``; ``bindings`` are the variables that have
    a value, by name. A plan gives one option, for the first solution of its context, or with the label annotation
    ``all_unifs`` one for each solution.
    """

    event: WaitingEvent
    plan: Any
    bindings: dict[str, Any]
    frame: Frame
    bound: tuple[tuple[Var, Any], ...]

    def annotation(self, name: str) -> Literal | None:
        """Return the annotation of the plan's label with this name, such as ``priority(2)``."""
        return next((a for a in self.plan.label.annots if type(a) is Literal and a.sig.functor == name), None)


def by_function(selector: Selector) -> Select:
    """Let a function of the embedder's choose the plan for an event."""
    return _choosing(partial(_by_function, selector))


def _choosing(choice: Callable[[MindState, Trail, Event, list[tuple[Any, Any]]], Frame | None]) -> Select:
    """Return the function that finds the option that is chosen, with its bindings on the trail; None if none is."""

    def select(mind: MindState, trail: Trail, event: Event) -> Frame | None:
        rejected: list[tuple[Any, Any]] = []
        shown = held_all(event[1])
        mind.plans.taken = event
        try:
            frame = choice(mind, trail, event, rejected)
        finally:
            mind.plans.taken = None
        if mind.recorder is not None:
            mind.recorder.decided(event, shown, rejected or None, frame, bound=True)
        return frame

    return select


def _by_function(
    selector: Selector, mind: MindState, trail: Trail, event: Event, rejected: list[tuple[Any, Any]]
) -> Frame | None:
    mark = len(trail)
    options: list[Option] = []
    for plan, frame in _applicable(mind, trail, event, rejected, every=False):
        bound = tuple((variable, variable.ref) for variable in trail[mark:])
        options.append(Option(WaitingEvent.of(event), plan, _bindings(plan, frame), frame, bound))
    undo(trail, mark)
    place = choose(mind, selector, "select_option", options) if options else None
    rejected += [(option.plan, PASSED_OVER) for number, option in enumerate(options) if number != place]
    if place is None:
        return None
    chosen = options[place]
    for variable, value in chosen.bound:
        variable.ref = value
        trail.append(variable)
    return chosen.frame


def _applicable(
    mind: MindState, trail: Trail, event: Event, rejected: list[tuple[Any, Any]], every: bool
) -> Iterator[tuple[Any, Frame]]:
    """Yield each applicable plan and frame while its bindings are there, all solutions if ``every`` or asked for.

    Plans that are not applicable are added to ``rejected``, with the reason.
    """
    relevant, args, annots, intention = event
    mark = len(trail)
    for plan, around in candidates(mind, relevant, intention):
        found = False
        try:
            for result in plan.options(mind, trail, relevant, args, annots, around):
                if type(result) is not list:
                    if not found:
                        rejected.append((plan, result))
                    break
                found = True
                yield plan, result
                if not (every or any(type(a) is Literal and a.sig is _ALL for a in plan.label.annots)):
                    break
        except Exception as error:  # an internal action may raise anything; it must not end the mind
            context_failed(mind, relevant, plan, error)
            rejected.append((plan, error.with_traceback(None)))
        undo(trail, mark)


def _bindings(plan: Plan, frame: Frame) -> dict[str, Any]:
    values = {name: deref(frame[plan.slots[name]]) for name in plan.bound}
    return {name: resolve(value) for name, value in values.items() if type(value) is not Var}


def _by_rule(mind: MindState, trail: Trail, event: Event, rejected: list[tuple[Any, Any]]) -> Frame | None:
    relevant, args, annots, intention = event
    trigger = nodes.Trigger(relevant.operator, relevant.goal, nodes.Variable("Event"))
    for plan, frame in _applicable(mind, trail, event, rejected, every=True):
        literal = Literal(relevant.sig, resolve_all(args), resolve_all(annots))
        asked = (
            Code(trigger, {"Event": literal}),
            atom("none")
            if intention is None
            else Literal(_INTENTION, (float(intention.id), stack_of(mind, intention))),
            term_of(plan),
            make_list([Literal(_MAP, (name, value)) for name, value in _bindings(plan, frame).items()]),
        )
        if _holds(mind, trail, asked):
            return frame
        if not rejected or rejected[-1] != (plan, PASSED_OVER):
            rejected.append((plan, PASSED_OVER))
    return None


by_rule: Final = _choosing(_by_rule)
"""Chooses the plan for an event by the program's rule `RULE`."""


def _holds(mind: MindState, trail: Trail, asked: tuple[Term, ...]) -> bool:
    mark = len(trail)
    answers = mind.beliefs.predicate(RULE).solve((True,) * len(asked), asked, mind, trail)
    held = False
    for answer in answers:
        before = len(trail)
        held = all(unify(found, given, trail) for given, found in zip(asked, answer, strict=True))
        if held:
            break
        undo(trail, before)
    undo(trail, mark)
    return held
