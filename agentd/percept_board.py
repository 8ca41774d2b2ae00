"""What an environment lets its agents perceive, and which of it each agent has not been told yet.

A percept is known by its name and arguments: annotations take no part in comparisons, as in Jason. The work of a change
is proportional to the change (times the agents, for a percept of all).
"""

from __future__ import annotations

from collections.abc import Callable
from threading import RLock
from typing import TypeAlias

from agentd.language.signatures import Signature
from agentd.language.terms import Literal
from agentd.mind.inputs import PerceptsChanged

_Key: TypeAlias = tuple[Signature, tuple[object, ...]]
_Held: TypeAlias = dict[Signature, dict[tuple[object, ...], Literal]]


class PerceptBoard:
    """The percepts of all agents together, and of each alone. Any thread may change it."""

    def __init__(self) -> None:
        self.on_change: Callable[[], None] | None = None
        """Called after each change."""
        self._lock = RLock()
        self._common: _Held = {}
        self._own: dict[str, _Held] = {}
        self._untold: dict[str, dict[_Key, Literal]] = {}
        """Per agent that perceives: what has changed since it was told last."""

    def join(self, agent: str) -> None:
        """An agent begins to perceive."""
        with self._lock:
            held = [*self._all(self._common), *self._all(self._own.get(agent, {}))]
            self._untold[agent] = {(literal.sig, literal.args): literal for literal in held}

    def recall(self, agent: str, told: list[Literal]) -> None:
        """An agent believes what another one was told: it is to be told what of that holds for itself."""
        with self._lock:
            self._untold[agent].update({(literal.sig, literal.args): literal for literal in told})

    def leave(self, agent: str) -> None:
        """An agent is gone, with what it alone perceived."""
        with self._lock:
            self._untold.pop(agent, None)
            self._own.pop(agent, None)

    def add(self, literal: Literal, agent: str | None) -> None:
        with self._lock:
            self._add(literal, agent)
        if self.on_change is not None:
            self.on_change()

    def remove(self, literal: Literal, agent: str | None) -> None:
        with self._lock:
            present = self._held(agent).get(literal.sig)
            if present is not None and present.pop(literal.args, None) is not None:
                self._changed(literal, agent)
        if self.on_change is not None:
            self.on_change()

    def replace(self, literal: Literal, agent: str | None) -> None:
        with self._lock:
            held = self._held(agent)
            old = held.get(literal.sig, {})
            held[literal.sig] = {literal.args: literal}
            for args, other in old.items():
                if args != literal.args:
                    self._changed(other, agent)
            if literal.args not in old:
                self._changed(literal, agent)
        if self.on_change is not None:
            self.on_change()

    def clear(self, agent: str | None) -> None:
        with self._lock:
            held = self._held(agent)
            gone = self._all(held)
            held.clear()
            for literal in gone:
                self._changed(literal, agent)
        if self.on_change is not None:
            self.on_change()

    def seen_by(self, agent: str | None) -> list[Literal]:
        """What an agent perceives, or what all do."""
        with self._lock:
            found = {(literal.sig, literal.args): literal for literal in self._all(self._common)}
            if agent is not None:
                found.update({(literal.sig, literal.args): literal for literal in self._all(self._own.get(agent, {}))})
            return list(found.values())

    def take(self, agent: str) -> PerceptsChanged | None:
        """What has to be told to an agent, if anything; it counts as told."""
        untold = self._untold.get(agent)
        if not untold:
            return None
        gone: list[Literal] = []
        new: list[Literal] = []
        with self._lock:
            self._untold[agent] = {}
            common, own = self._common, self._own.get(agent)
            for (sig, args), literal in untold.items():
                if args in common.get(sig, ()) or (own is not None and args in own.get(sig, ())):
                    new.append(literal)
                else:
                    gone.append(literal)
        return PerceptsChanged(tuple(gone), tuple(new))

    def _held(self, agent: str | None) -> _Held:
        return self._common if agent is None else self._own.setdefault(agent, {})

    def _add(self, literal: Literal, agent: str | None) -> None:
        present = self._held(agent).setdefault(literal.sig, {})
        if literal.args not in present:
            present[literal.args] = literal
            self._changed(literal, agent)

    def _changed(self, literal: Literal, agent: str | None) -> None:
        key = (literal.sig, literal.args)
        if agent is None:
            for untold in self._untold.values():
                untold[key] = literal
        elif agent in self._untold:
            self._untold[agent][key] = literal

    @staticmethod
    def _all(held: _Held) -> list[Literal]:
        return [literal for group in held.values() for literal in group.values()]
