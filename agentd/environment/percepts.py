"""What an environment lets its agents perceive, and which of it each agent has not been told yet.

A percept is known by its name and arguments: annotations take no part in comparisons, as in Jason. The work of a change
is proportional to the change (times the agents, for a percept of all).
"""

from __future__ import annotations

from collections.abc import Callable
from threading import Lock
from typing import Any, TypeAlias

from agentd.language.syntax_tree.signatures import Signature
from agentd.language.terms.terms import Literal
from agentd.mind.data.inputs import PerceptKey, PerceptsChanged

_Held: TypeAlias = dict[Signature, dict[tuple[Any, ...], Literal]]


class PerceptBoard:
    """The percepts of all agents together, and of each alone. Any thread may change it.

    The literals given to it are ground (see `agentd.mind.beliefs.term_copy.resolve`).
    """

    def __init__(self) -> None:
        self.changed = False
        """Whether something has changed since somebody set this to false."""
        self.on_change: Callable[[], None] | None = None
        """Called after each change, while somebody waits for one."""
        self._lock = Lock()
        self._common: _Held = {}
        self._own: dict[str, _Held] = {}
        self._untold: dict[str, dict[PerceptKey, Literal | None]] = {}
        """Per agent that perceives, what has changed since it was told last: None for a percept that is gone."""

    def join(self, agent: str) -> None:
        """An agent begins to perceive."""
        with self._lock:
            self._untold[agent] = {(literal.sig, literal.args): literal for literal in self._seen_by(agent)}
        self.changed = True

    def recall(self, agent: str, told: list[Literal]) -> None:
        """An agent believes what another one was told: it is to be told what of that does not hold for itself."""
        with self._lock:
            for literal in told:
                self._gone(literal.sig, literal.args, agent)
        self.changed = True

    def leave(self, agent: str) -> None:
        """An agent is gone, with what it alone perceived."""
        with self._lock:
            self._untold.pop(agent, None)
            self._own.pop(agent, None)

    def add(self, literal: Literal, agent: str | None) -> None:
        with self._lock:
            present = self._held(agent).setdefault(literal.sig, {})
            if literal.args not in present:
                present[literal.args] = literal
                self._new(literal, agent)
        self._tell()

    def remove(self, literal: Literal, agent: str | None) -> None:
        with self._lock:
            present = self._held(agent).get(literal.sig)
            if present is not None and present.pop(literal.args, None) is not None:
                self._gone(literal.sig, literal.args, agent)
        self._tell()

    def replace(self, literal: Literal, agent: str | None) -> None:
        with self._lock:
            held = self._common if agent is None else self._held(agent)
            sig, args = literal.sig, literal.args
            old = held.get(sig, ())
            held[sig] = {args: literal}
            if agent is None and not self._own:
                for untold in self._untold.values():
                    for other in old:
                        if other != args:
                            untold[sig, other] = None
                    if args not in old:
                        untold[sig, args] = literal
            else:
                for other in old:
                    if other != args:
                        self._gone(sig, other, agent)
                if args not in old:
                    self._new(literal, agent)
        self.changed = True
        if self.on_change is not None:
            self.on_change()

    def clear(self, agent: str | None) -> None:
        with self._lock:
            held = self._held(agent)
            gone = [(sig, args) for sig, group in held.items() for args in group]
            held.clear()
            for sig, args in gone:
                self._gone(sig, args, agent)
        self._tell()

    def seen_by(self, agent: str | None) -> list[Literal]:
        """What an agent perceives, or what all do."""
        with self._lock:
            return self._seen_by(agent)

    def take(self, agent: str) -> PerceptsChanged | None:
        """What has to be told to an agent, if anything; it counts as told."""
        untold = self._untold.get(agent)
        if not untold:
            return None
        with self._lock:
            self._untold[agent] = {}
        return PerceptsChanged(untold)

    def _tell(self) -> None:
        self.changed = True
        if self.on_change is not None:
            self.on_change()

    def _held(self, agent: str | None) -> _Held:
        return self._common if agent is None else self._own.setdefault(agent, {})

    def _seen_by(self, agent: str | None) -> list[Literal]:
        found: dict[PerceptKey, Literal] = {}
        for held in (self._common, {} if agent is None else self._own.get(agent, {})):
            for sig, group in held.items():
                found.update(((sig, args), literal) for args, literal in group.items())
        return list(found.values())

    def _new(self, literal: Literal, agent: str | None) -> None:
        key = (literal.sig, literal.args)
        if agent is None:
            for untold in self._untold.values():
                untold[key] = literal
        elif agent in self._untold:
            self._untold[agent][key] = literal

    def _gone(self, sig: Signature, args: tuple[Any, ...], agent: str | None) -> None:
        """A percept is told to be gone to those who do not perceive it otherwise, as one of all or of their own."""
        key = (sig, args)
        if agent is not None:
            if agent in self._untold and args not in self._common.get(sig, ()) and not self._is_own(sig, args, agent):
                self._untold[agent][key] = None
            return
        for name, untold in self._untold.items():
            if not self._own or not self._is_own(sig, args, name):
                untold[key] = None

    def _is_own(self, sig: Signature, args: tuple[Any, ...], agent: str) -> bool:
        own = self._own.get(agent)
        return own is not None and args in own.get(sig, ())
