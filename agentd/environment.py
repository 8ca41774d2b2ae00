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

Nothing else is needed: the agents perceive each change before their next step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from threading import Lock
from typing import TYPE_CHECKING, Any, TypeAlias

from agentd.language.parse import parse_literal
from agentd.language.syntax_tree.signatures import Signature
from agentd.language.terms.from_ast import instantiate
from agentd.language.terms.terms import Literal, atom
from agentd.mind.beliefs.term_copy import is_ground, resolve
from agentd.mind.data.inputs import PerceptKey, PerceptsChanged
from agentd.mind.data.registry import missing_action
from agentd.values import literal, term_of, value_of

if TYPE_CHECKING:
    from agentd.mind.state import MindState

__all__ = ["ActionFailed", "Deferred", "Environment", "Literal", "atom", "literal", "term_of", "value_of"]


class ActionFailed(Exception):
    """Raised by `Environment.execute`: the action failed; the text is the reason for the agent."""


class Deferred:
    """The outcome of an action that is not known yet. Any thread may settle it, once; later calls change nothing.

    It may be returned for several actions, which then end together.
    """

    def __init__(self) -> None:
        self.cancelled = False
        """Whether the intentions that waited for the action are gone."""
        self.outcome: tuple[bool, str] | None = None
        self._waiting: dict[object, Callable[[], None]] = {}
        self._lock = Lock()

    def succeed(self) -> None:
        """Report that the action was done."""
        self._settle(True, "")

    def fail(self, reason: str) -> None:
        """Report that the action failed; ``reason`` is a text for people."""
        self._settle(False, reason)

    def _settle(self, ok: bool, reason: str) -> None:
        with self._lock:
            if self.outcome is not None:
                return
            self.outcome = (ok, reason)
            waiting, self._waiting = self._waiting, {}
        for notify in waiting.values():
            notify()

    def when_settled(self, who: object, notify: Callable[[], None]) -> None:
        """Call `notify` when it is settled; for the host of the environment."""
        with self._lock:
            self.cancelled = False
            if self.outcome is None:
                self._waiting[who] = notify
                return
        notify()

    def forget(self, who: object) -> None:
        """Remove one that waits; for the host of the environment."""
        with self._lock:
            self._waiting.pop(who, None)
            self.cancelled = not self._waiting


class Environment:
    """The environment of agents. Derive from it, and name the class: ``agentd run --env module:Class``.

    Your methods are called in one thread, one at a time. Percepts may be changed from any thread; they are literals or
    their texts. ``agent=None`` means every agent, also those that are created later.
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
        """Perform an action of an agent. Return whether it succeeded, or a `Deferred` if that is known later.

        Raise `ActionFailed` with the reason of a failure. Pass actions of other names to
        ``super().execute(agent, action)``, which fails them as unknown.
        """
        if "." in action.sig.name:  # an internal action that does not exist is handed to the environment
            raise ActionFailed(missing_action(action.sig.name, action.sig.arity))
        raise ActionFailed(f"the environment has no action {action.sig.indicator}")

    def perceive(self, agent: str) -> None:
        """Called when an agent asks for its percepts by ``.perceive``, to bring them up to date."""

    def joined(self, agent: str) -> None:
        """Called when an agent is created, before its first step."""

    def stop(self) -> None:
        """Called once when the run ends."""

    # --- yours to call ---

    def add_percept(self, percept: Literal | str, agent: str | None = None) -> None:
        """Add a percept, which holds from now on."""
        self._board.add(_read(percept), agent)

    def remove_percept(self, percept: Literal | str, agent: str | None = None) -> None:
        """Remove a percept, if it is there."""
        self._board.remove(_read(percept), agent)

    def replace_percept(self, percept: Literal | str, agent: str | None = None) -> None:
        """Put a percept in the place of all of the same name and number of arguments."""
        if type(percept) is not Literal or not percept.ground:
            percept = _read(percept)
        self._board.replace(percept, agent)

    def clear_percepts(self, agent: str | None = None) -> None:
        """Remove the percepts of this agent alone, or those of all (``None``)."""
        self._board.clear(agent)

    def percepts(self, agent: str | None = None) -> list[Literal]:
        """Return the percepts of an agent, or those of all."""
        return self._board.seen_by(agent)

    def after(self, seconds: float, call: Callable[[], object]) -> None:
        """Call something in `seconds` of the run's clock, 0 or more (in tests, that is virtual time)."""
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
    """Return a percept as it is stored: ground, without bound variables inside."""
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
    """Parse a percept. Raises `agentd.language.syntax_tree.errors.SyntaxErrors`."""
    read = instantiate(parse_literal(text, "<percept>"))
    if type(read) is not Literal:
        raise TypeError(f"{text} is no percept: a literal such as at(3,4) is needed")
    return _resolved(read)


_Held: TypeAlias = dict[Signature, dict[tuple[Any, ...], Literal]]


class PerceptBoard:
    """The percepts of all agents together and of each alone, and the changes that each has not perceived yet.

    Any thread may change it. The literals are ground (see `agentd.mind.beliefs.term_copy.resolve`) and compared by name
    and arguments, without annotations, as in Jason. The cost of a change is proportional to the change (times the
    agents, for a percept of all).
    """

    def __init__(self) -> None:
        self.changed = False
        """Whether something has changed since this was set to false."""
        self.on_change: Callable[[], None] | None = None
        """Called after each change; None while nothing waits for one."""
        self._lock = Lock()
        self._common: _Held = {}
        self._own: dict[str, _Held] = {}
        self._unperceived: dict[str, dict[PerceptKey, Literal | None]] = {}
        """By agent, the changes that it has not perceived: None for a percept that is gone."""

    def join(self, agent: str) -> None:
        """Let an agent perceive from now on."""
        with self._lock:
            self._unperceived[agent] = {(literal.sig, literal.args): literal for literal in self._seen_by(agent)}
        self.changed = True

    def recall(self, agent: str, percepts: list[Literal]) -> None:
        """Retract the percepts of another agent that do not hold for this one, which is a copy of it."""
        with self._lock:
            for literal in percepts:
                self._gone(literal.sig, literal.args, agent)
        self.changed = True

    def leave(self, agent: str) -> None:
        """Remove an agent and its own percepts."""
        with self._lock:
            self._unperceived.pop(agent, None)
            self._own.pop(agent, None)

    def add(self, literal: Literal, agent: str | None) -> None:
        """Add a percept of an agent (None: of all)."""
        with self._lock:
            present = self._held(agent).setdefault(literal.sig, {})
            if literal.args not in present:
                present[literal.args] = literal
                self._new(literal, agent)
        self._notify()

    def remove(self, literal: Literal, agent: str | None) -> None:
        """Remove a percept of an agent (None: of all)."""
        with self._lock:
            present = self._held(agent).get(literal.sig)
            if present is not None and present.pop(literal.args, None) is not None:
                self._gone(literal.sig, literal.args, agent)
        self._notify()

    def replace(self, literal: Literal, agent: str | None) -> None:
        """Put a percept in the place of all with its name and number of arguments."""
        sig, args = literal.sig, literal.args
        self._lock.acquire()  # with `with` it would take twice as long
        try:
            held = self._common if agent is None else self._held(agent)
            old = held.get(sig, ())
            held[sig] = {args: literal}
            is_new = args not in old
            if agent is None and not self._own:
                for changes in self._unperceived.values():
                    for other in old:
                        if is_new or other != args:
                            changes[sig, other] = None
                    if is_new:
                        changes[sig, args] = literal
            else:
                for other in old:
                    if is_new or other != args:
                        self._gone(sig, other, agent)
                if is_new:
                    self._new(literal, agent)
        finally:
            self._lock.release()
        self.changed = True
        if self.on_change is not None:
            self.on_change()

    def clear(self, agent: str | None) -> None:
        """Remove all percepts of an agent (None: those of all)."""
        with self._lock:
            held = self._held(agent)
            gone = [(sig, args) for sig, group in held.items() for args in group]
            held.clear()
            for sig, args in gone:
                self._gone(sig, args, agent)
        self._notify()

    def seen_by(self, agent: str | None) -> list[Literal]:
        """Return the percepts of an agent, or those of all."""
        with self._lock:
            return self._seen_by(agent)

    def feed(self, minds: Mapping[str, MindState]) -> None:
        """Feed each mind the changes that it has not perceived."""
        self.changed = False
        for agent, mind in minds.items():
            changes = self._unperceived.get(agent)
            if changes:
                self._lock.acquire()
                self._unperceived[agent] = {}
                self._lock.release()
                mind.feed(PerceptsChanged(changes))

    def _notify(self) -> None:
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
            for changes in self._unperceived.values():
                changes[key] = literal
        elif agent in self._unperceived:
            self._unperceived[agent][key] = literal

    def _gone(self, sig: Signature, args: tuple[Any, ...], agent: str | None) -> None:
        """Retract a percept for the agents that do not also perceive it as one of all, or of their own."""
        key = (sig, args)
        if agent is not None:
            if (
                agent in self._unperceived
                and args not in self._common.get(sig, ())
                and not self._is_own(sig, args, agent)
            ):
                self._unperceived[agent][key] = None
            return
        for name, changes in self._unperceived.items():
            if not self._own or not self._is_own(sig, args, name):
                changes[key] = None

    def _is_own(self, sig: Signature, args: tuple[Any, ...], agent: str) -> bool:
        own = self._own.get(agent)
        return own is not None and args in own.get(sig, ())
