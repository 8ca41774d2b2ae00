"""How far an action is, as the agent perceives it while the action runs: `feedback(Action, What, Value)`."""

from __future__ import annotations

from collections.abc import Mapping

from bridged.bridge.percepts import PerceptPublisher
from schemas.manifest.loader import ActionEntry
from schemas.manifest.rules import FUNCTOR
from schemas.wire.terms import Atom, Term, number

MAX_FEEDBACK = 16
"""Figures of one action's progress that its agent perceives at most."""
NAME = "feedback"
CAUSE = "cause"
"""What hinders the action, a text beside the figures."""
KEY = (0, 1)
"""A figure takes the place of the one before it of the same action and kind."""


class Progress:
    """The figures of one action that runs."""

    def __init__(self, board: PerceptPublisher, agent: str, action: str, entry: ActionEntry) -> None:
        """`entry` says which figures are wanted; none named = all that the driver tells."""
        self._board, self._agent, self._action, self._wanted = board, agent, Atom(action), entry.feedback
        self._shown: frozenset[str] = frozenset()

    def show(self, feedback: Mapping[str, float], cause: str = "") -> None:
        """Let the agent perceive these figures and what hinders the action, and nothing else of it."""
        told: dict[str, Term] = {what: number(value) for what, value in feedback.items() if self._is_wanted(what)}
        if cause and self._is_wanted(CAUSE):
            told[CAUSE] = cause
        shown = sorted(told)[:MAX_FEEDBACK]
        for what in sorted(self._shown.difference(shown)):
            self._board.withdraw(self._agent, NAME, (self._action, Atom(what)))
        for what in shown:
            self._board.show(self._agent, NAME, (self._action, Atom(what), told[what]), KEY)
        self._shown = frozenset(shown)

    def end(self) -> None:
        """The action has ended: so have its figures."""
        self.show({})

    def _is_wanted(self, what: str) -> bool:
        return FUNCTOR.fullmatch(what) is not None and (self._wanted is None or what in self._wanted)
