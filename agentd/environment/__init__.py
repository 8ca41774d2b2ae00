"""Environments in Python: what the agents of ``agentd run`` and ``agentd test`` perceive, and what their actions do.

    class Counter(Environment):
        def init(self, arguments):
            self.count = 0
            self.add_percept(literal("counter", 0))

        def execute(self, agent, action):
            if action.functor == "next":
                self.count += 1
                self.replace_percept(literal("counter", self.count))
                return True
            return super().execute(agent, action)

Nothing else has to be done: what changes is told to the agents that it concerns, before their next step.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from threading import Lock
from typing import Any

from agentd.environment.percepts import PerceptBoard
from agentd.language.parse import parse_literal
from agentd.language.terms.from_ast import instantiate
from agentd.language.terms.terms import Literal, atom
from agentd.mind.beliefs.term_copy import is_ground, resolve
from agentd.mind.data.registry import missing_action
from agentd.values import literal, term_of, value_of

__all__ = ["ActionFailed", "Deferred", "Environment", "Literal", "atom", "literal", "term_of", "value_of"]


class ActionFailed(Exception):
    """Raised by `Environment.execute`: the action failed; the text is the reason that the agent is told."""


class Deferred:
    """The outcome of an action that is not known yet. Any thread may settle it, once; later calls change nothing.

    It may be returned for several actions, which then end together.
    """

    def __init__(self) -> None:
        self.cancelled = False
        """Whether the intentions that waited for the action are gone: nobody asks for the outcome any more."""
        self.outcome: tuple[bool, str] | None = None
        self._waiting: dict[object, Callable[[], None]] = {}
        self._lock = Lock()

    def succeed(self) -> None:
        """The action was done."""
        self._settle(True, "")

    def fail(self, reason: str) -> None:
        """The action failed; ``reason`` tells why, in words."""
        self._settle(False, reason)

    def _settle(self, ok: bool, reason: str) -> None:
        with self._lock:
            if self.outcome is not None:
                return
            self.outcome = (ok, reason)
            waiting, self._waiting = self._waiting, {}
        for told in waiting.values():
            told()

    def when_settled(self, who: object, told: Callable[[], None]) -> None:
        """Have one who waits told; for the host of the environment."""
        with self._lock:
            self.cancelled = False
            if self.outcome is None:
                self._waiting[who] = told
                return
        told()

    def forget(self, who: object) -> None:
        """One who waited is gone; for the host of the environment."""
        with self._lock:
            self._waiting.pop(who, None)
            self.cancelled = not self._waiting


class Environment:
    """What agents live in. Derive from it, and name the class: ``agentd run --env module:Class``.

    All methods of yours are called in one thread, one after another. Percepts may be changed from any thread; they are
    literals or their texts. ``agent=None`` means every agent, also those that are created later.
    """

    _board: PerceptBoard
    _host: Any

    def __new__(cls, *args: Any, **kwargs: Any) -> Environment:
        made = super().__new__(cls)
        made._board = PerceptBoard()
        made._host = None
        return made

    # --- yours to write ---

    def init(self, arguments: list[str]) -> None:
        """Called once before the agents begin; ``arguments`` are those of ``--env-arg``, or of the project file."""

    def execute(self, agent: str, action: Literal) -> bool | Deferred:
        """Do an action of an agent: true if it was done, false if it failed; a `Deferred` when that shows later.

        Raise `ActionFailed` to tell the reason. Actions of other names go to ``super().execute(agent, action)``, which
        fails them as unknown.
        """
        if "." in action.sig.name:  # an internal action that does not exist is handed to the environment
            raise ActionFailed(missing_action(action.sig.name, action.sig.arity))
        raise ActionFailed(f"the environment has no action {action.sig.indicator}")

    def perceive(self, agent: str) -> None:
        """Called when an agent asks for its percepts by ``.perceive``, to bring them up to date."""

    def joined(self, agent: str) -> None:
        """Called when an agent comes into being, before its first step."""

    def stop(self) -> None:
        """Called once when the run ends."""

    # --- yours to call ---

    def add_percept(self, percept: Literal | str, agent: str | None = None) -> None:
        """The percept holds from now on."""
        self._board.add(_read(percept), agent)

    def remove_percept(self, percept: Literal | str, agent: str | None = None) -> None:
        """The percept holds no longer; nothing happens if it did not."""
        self._board.remove(_read(percept), agent)

    def replace_percept(self, percept: Literal | str, agent: str | None = None) -> None:
        """The percept takes the place of all of the same name and number of arguments."""
        if type(percept) is not Literal or not percept.ground:
            percept = _read(percept)
        self._board.replace(percept, agent)

    def clear_percepts(self, agent: str | None = None) -> None:
        """None of the percepts told to this agent alone, or to all (``None``), holds any longer."""
        self._board.clear(agent)

    def percepts(self, agent: str | None = None) -> list[Literal]:
        """The percepts that an agent has, or those that all have."""
        return self._board.seen_by(agent)

    def after(self, seconds: float, call: Callable[[], object]) -> None:
        """Call something after so many seconds of the run's clock (in tests, that is virtual time)."""
        self._running().after(seconds, call)

    @property
    def now(self) -> float:
        """Seconds since the run began, by its clock."""
        return float(self._running().now())

    def _running(self) -> Any:
        if self._host is None:
            raise RuntimeError("the run has not begun in __init__: its clock can be used from init on")
        return self._host


def _read(percept: Literal | str) -> Literal:
    """A percept as it is kept: ground, without bound variables inside."""
    if type(percept) is not Literal:
        return _literal(str(percept))
    return percept if percept.ground else _resolved(percept)


def _resolved(percept: Literal) -> Literal:
    found = resolve(percept)
    if type(found) is not Literal or not is_ground(found):
        raise TypeError(f"{percept} is no percept: it has a variable without a value")
    found.ground = True
    return found


@lru_cache(maxsize=1000)
def _literal(text: str) -> Literal:
    """A percept from its text. Raises `agentd.language.syntax_tree.errors.SyntaxErrors`."""
    read = instantiate(parse_literal(text, "<percept>"))
    if type(read) is not Literal:
        raise TypeError(f"{text} is no percept: a literal such as at(3,4) is needed")
    return _resolved(read)
