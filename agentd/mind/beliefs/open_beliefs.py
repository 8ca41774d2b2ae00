"""Beliefs with free variables that are added at run time: within one plan such a variable stands for one value.

Rule 53. The initial beliefs of this kind are rules, which rename their variables at each use
(`agentd.mind.execution.program_loading`). The variable of a belief that is added is not renamed where it is asked
for: once it has matched a value it keeps it for the rest of that plan, and for the rest of a rule's body. Each plan,
context and rule has a *scope*: which variable of its own stands for which variable of a belief. The first belief of
this kind installs all this in a mind; others never pay for it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final

from agentd.language.terms.terms import Var

Scope = dict[Var, Var]
Frame = list[Any]

_MOST_FRAMES: Final = 1000


class OpenBeliefs:
    """The scopes of one mind."""

    def __init__(self, running: Callable[[], Iterable[Frame]]) -> None:
        """``running`` gives the frames of all plans that run."""
        self._running = running
        self.installed = False
        self._scope: Scope | None = None
        """The scope of the context or rule that is being evaluated; None while a formula of a body runs."""
        self._frames: dict[int, tuple[Frame, Scope]] = {}
        """The scopes of plans that run, by the identity of their frames."""

    def here(self, frame: Frame | None) -> Scope:
        """The scope of what is being evaluated; ``frame`` is that of the plan that runs, None for something else."""
        if self._scope is not None:
            return self._scope
        if frame is None:
            return {}
        known = self._frames.get(id(frame))
        if known is None or known[0] is not frame:
            known = self._note(frame, {})
        return known[1]

    def rule(self, answers: Callable[..., Iterator[Any]]) -> Callable[..., Iterator[Any]]:
        """A rule's generator of answers, run in a scope of its own."""

        def in_scope(*args: Any) -> Iterator[Any]:
            scope: Scope = {}
            found = answers(*args)
            while True:
                outer, self._scope = self._scope, scope
                try:
                    answer = next(found)
                except StopIteration:
                    return
                finally:
                    self._scope = outer
                yield answer

        return in_scope

    def select_in_scope(self, select: Callable[..., Frame | None], *asked: Any) -> Frame | None:
        """Select a plan (`agentd.mind.plans.plan_library.Select`) in a scope that its frame keeps."""
        scope: Scope = {}
        self._scope = scope
        try:
            frame = select(*asked)
        finally:
            self._scope = None
        if frame is not None and scope:
            self._note(frame, scope)
        return frame

    def _note(self, frame: Frame, scope: Scope) -> tuple[Frame, Scope]:
        if len(self._frames) >= _MOST_FRAMES:
            running = {id(other) for other in self._running()}
            self._frames = {key: known for key, known in self._frames.items() if key in running}
        noted = self._frames[id(frame)] = (frame, scope)
        return noted
