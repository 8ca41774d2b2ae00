"""Percepts put by hand, besides those of the bridge, in missions with `inject: true`.

They hold until they are removed by hand, whatever happens to the bridge.
"""

from __future__ import annotations

import logging
import re
from collections import Counter
from collections.abc import Callable

import msgspec
from msgspec.structs import replace

from commd.bus.bus import Bus
from commd.common.repeated_log import is_logged
from schemas.wire import keys
from schemas.wire.percept_set import PerceptSet, key_problem
from schemas.wire.records import Note, Perception
from schemas.wire.terms import Map, OpenList, Queue, Set, Source, Structure, Term, Variable

MOST = 1000
"""Percepts by hand of one agent; further ones are refused and counted."""
LARGEST = 4096
"""Bytes of one, as MessagePack."""
NAMED = 5
"""Names in the note about them."""
_NAME = re.compile(r"[a-z][A-Za-z0-9_]*", re.ASCII)
_NO_BELIEFS = frozenset(("if", "elif", "else", "while", "for", "div", "mod", "not", "true", "false"))
"""Words that cannot be the name of a belief."""
log = logging.getLogger("percepts")


class HandPercepts:
    """The percepts of one agent that were put by hand."""

    def __init__(self, agent: str, allowed: bool, counters: Counter[str]) -> None:
        """`allowed`: the mission has `inject: true`; `counters` counts accepted, ignored and refused ones."""
        self.percepts = PerceptSet()
        self.counters = counters
        self._agent, self._allowed = agent, allowed

    def take(self, key: str, perception: Perception) -> list[Perception]:
        """Apply what was put on `key`. Returns the changes, removals first."""
        name = key.rpartition("/")[2]
        if not self._allowed:
            self.counters["by_hand_ignored"] += 1
            if self.counters["by_hand_ignored"] == 1:
                why = "and so are further ones: the mission does not have `inject: true`"
                log.warning("agent=%s a percept `%s` put by hand is ignored, %s", self._agent, name, why)
            return []
        if problem := self._problem(name, perception) or self._no_room(replace(perception, name=name)):
            self.counters["by_hand_refused"] += 1
            if is_logged(count := self.counters["by_hand_refused"]):
                log.warning("agent=%s percept by hand refused count=%d: %s", self._agent, count, problem)
            return []
        given = replace(perception, name=name)
        if given.update == "remove" and not given.parameters:
            every = [replace(given, parameters=(0,) * arity, key=()) for arity in self.percepts.arities(name)]
            changes = [change for one in every for change in self.percepts.alter(one)]
        else:
            changes = self.percepts.alter(given)
        self.counters["by_hand"] += 1
        log.info("agent=%s percept by hand: %s %s", self._agent, given.update, name)
        return changes

    def notes(self) -> tuple[Note, ...]:
        """Return a note with their number, so that nobody forgets them."""
        count, names = len(self.percepts), self.percepts.names()
        if not count:
            return ()
        more = ", ..." if len(names) > NAMED else ""
        what = "percept by hand holds" if count == 1 else "percepts by hand hold"
        which = f"{', '.join(names[:NAMED])}{more}"
        return (Note("percepts_by_hand", f"{count} {what}, until removed by hand: {which}", which, count),)

    def _problem(self, name: str, perception: Perception) -> str:
        if perception.name not in ("", name):
            return f"the key has {name}, the percept has {perception.name}"
        if not _NAME.fullmatch(name) or name in _NO_BELIEFS:
            return f"expected a name such as `victim`, got `{name[:100]}`"
        if name == "bridge":
            return "`bridge` is the agent's own percept of its robot's bridge"
        if problem := key_problem(perception):
            return f"{name}: {problem}"
        if not all(map(_is_value, perception.parameters)):
            return f"{name}: expected values, got a variable or a part of a program"
        if (size := len(_ENCODE(perception.parameters))) > LARGEST:
            return f"{name}: expected at most {LARGEST} bytes, got {size}"
        return ""

    def _no_room(self, perception: Perception) -> str:
        if len(self.percepts) < MOST or perception.update == "remove" or self.percepts.holds(perception):
            return ""
        if perception.update == "replace" and self.percepts.concerned(perception):
            return ""
        return f"there are {MOST} already"


class HandPerceptSubscription:
    """Percepts put by hand for the agents without a robot of one daemon: one subscription for all of them."""

    def __init__(self, bus: Bus) -> None:
        self._agents: dict[str, tuple[HandPercepts, Callable[[Perception], None]]] = {}
        bus.subscribe(keys.percept_by_hand(bus.fleet, "*", "*"), Perception, self._heard)

    def add(self, agent: str, allowed: bool, on_change: Callable[[Perception], None]) -> HandPercepts:
        """Give an agent its percepts, if the mission allows them."""
        by_hand = HandPercepts(agent, allowed, Counter())
        self._agents[agent] = by_hand, on_change
        return by_hand

    def remove(self, agent: str) -> None:
        """Forget an agent that has ended."""
        self._agents.pop(agent, None)

    def _heard(self, key: str, perception: Perception) -> None:
        if (parsed := keys.parse(key)) is not None and (of_agent := self._agents.get(parsed[1])) is not None:
            by_hand, on_change = of_agent
            for change in by_hand.take(key, perception):
                on_change(change)


def _is_value(term: Term) -> bool:
    """Return whether a term may be an argument of a belief: it has no variable and no source text."""
    waiting: list[Term] = [term]
    while waiting:
        match waiting.pop():
            case Variable() | OpenList() | Source():
                return False
            case Structure(args=args, annotations=annotations):
                waiting += (*args, *annotations)
            case Map(entries=entries):
                waiting += (side for entry in entries for side in entry)
            case Set(items=items) | Queue(items=items):
                waiting += items
            case list() as items:
                waiting += items
            case _:
                pass
    return True


_ENCODE = msgspec.msgpack.Encoder().encode
