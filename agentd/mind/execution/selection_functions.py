"""Selection functions: which message, event, option and intention comes next, where a mind does not follow its default.

The defaults are Jason's: the oldest message, the oldest event, the first applicable plan in file order, the intention
whose turn it is. A function of the embedder's, ``select_message``, ``select_event``, ``select_option`` or
``select_intention``, takes the mind and what there is to choose from, and returns one of it, or None for none in this
cycle (for options: no plan is applicable). A program may choose among options by a rule too
(`agentd.mind.execution.option_selection`).

A mind without selection functions runs nothing of this.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from agentd.language.terms.terms import Literal
from agentd.mind.beliefs.term_copy import resolve_all
from agentd.mind.data.inputs import Mail
from agentd.mind.execution.cycle import atomic_cycle, take_mail
from agentd.mind.execution.execution import run_intention
from agentd.mind.execution.goal_conditions import check_goal_conditions
from agentd.mind.execution.input_handling import take_inputs
from agentd.mind.execution.waiting import check_conditions
from agentd.mind.state import MindState

Selector = Callable[[MindState, Sequence[Any]], Any]

PATIENCE: Final = 1000
"""So many cycles in a row a selection function may choose nothing before that is told."""


@dataclass(frozen=True, slots=True)
class Event:
    """An event that waits.

    ``kind`` is ``+``, ``-``, ``+!``, ``-!``, ``+?`` or ``-?``, ``literal`` what it is about with its annotations,
    ``intention`` the id of the intention that waits for it (0: it is to begin one).
    """

    kind: str
    literal: Literal
    intention: int

    @staticmethod
    def of(event: Any) -> Event:
        """The view of an event of the queue."""
        relevant, args, annots, intention = event
        literal = Literal(relevant.sig, resolve_all(args), resolve_all(annots))
        return Event(relevant.text, literal, 0 if intention is None else intention.id)


class Chooser:
    """The selection functions of a mind that has some, and the cycle that asks them."""

    def __init__(self, mind: MindState, selectors: dict[str, Selector]) -> None:
        self._mind = mind
        self._message, self._event = selectors.get("select_message"), selectors.get("select_event")
        self._intention = selectors.get("select_intention")
        self._idle: dict[str, int] = {}

    def run_cycles(self, mind: MindState, cycles: int) -> None:
        """As `agentd.mind.execution.cycle.run_cycles`, asking the selection functions."""
        inputs, mailbox, events, running, effects = mind.inputs, mind.mailbox, mind.events, mind.running, mind.effects
        while cycles:
            cycles -= 1
            begin_cycle(mind)
            if mind.atomic is not None:
                if not atomic_cycle(mind) or effects:
                    return
                continue
            if mailbox:
                self._take_message(mailbox)
            while events:
                taken = self._take(events, self._event, "select_event", Event.of)
                if taken is None or mind.take_event(mind, taken):
                    break
            if running and mind.atomic is None:
                intention = self._take(running, self._intention, "select_intention", _itself)
                if intention is not None:
                    run_intention(mind, intention)
            elif not (events or inputs or mailbox):
                return
            if effects:
                return

    def _take_message(self, mailbox: deque[Mail]) -> None:
        mind = self._mind
        mail = self._take(mailbox, self._message, "select_message", _itself)
        if mail is not None:
            take_mail(mind, mail)

    def _take(self, queue: deque[Any], selector: Selector | None, name: str, view: Callable[[Any], Any]) -> Any:
        """Take out of a queue what the selection function chooses; None if it chooses nothing."""
        if selector is None:
            return queue.popleft()
        place = choose(self._mind, selector, name, [view(item) for item in queue])
        if place is None:
            self._idle[name] = self._idle.get(name, 0) + 1
            if self._idle[name] == PATIENCE:
                self._mind.warn_once(f"{name} has chosen none of {len(queue)} for {PATIENCE} cycles")
            return None
        self._idle[name] = 0
        item = queue[place]
        del queue[place]
        return item


def choose(mind: MindState, selector: Selector, name: str, items: list[Any]) -> int | None:
    """The place of what a selection function returns; None for none. A wrong answer is told, the first is taken."""
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


def begin_cycle(mind: MindState) -> None:
    """What a cycle does before it takes messages and events."""
    mind.cycle += 1
    if mind.inputs:
        take_inputs(mind)
    timers = mind.timers.heap
    if timers and timers[0].due <= mind.now:
        mind.timers.run(mind.now)
    if (mind.conditions or mind.goal_conditions) and mind.changes != mind.changes_seen:
        mind.changes_seen = mind.changes
        check_conditions(mind)
        check_goal_conditions(mind)


NAMES: Final = ("select_message", "select_event", "select_option", "select_intention")


def selectors_of(mind: MindState, given: Sequence[Selector | None]) -> dict[str, Selector]:
    """The selection functions of a mind by name: those given, else the methods of its class with these names."""
    found = {name: each or getattr(type(mind), name, None) for name, each in zip(NAMES, given, strict=True)}
    return {name: selector for name, selector in found.items() if selector is not None}
