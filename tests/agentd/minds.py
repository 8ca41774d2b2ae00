"""Minds in tests: made from source text, run on virtual time."""

from __future__ import annotations

from typing import Any

from agentd.conversion.log_format import line_of
from agentd.language.compiler.compile import compile_program
from agentd.language.parse import parse_program, parse_term
from agentd.language.terms.from_ast import instantiate
from agentd.mind import Mind
from agentd.mind.data.effects import Effect, Log, Print

MOST_CYCLES = 5_000_000


def mind_of(source: str, name: str = "bob", **arguments: Any) -> Mind:
    """A mind with a program given as text."""
    return Mind(name, compile_program(parse_program(source, "test.asl")), **arguments)


def term(text: str) -> Any:
    """A run-time term from its text."""
    return instantiate(parse_term(text))


class World:
    """Runs one mind and keeps what comes out of it. Time is what the test says it is."""

    def __init__(self, mind: Mind) -> None:
        self.mind, self.now = mind, mind.now
        self.effects: list[Effect] = []

    def settle(self) -> World:
        """Run until the mind has nothing to do at the present time."""
        for _ in range(MOST_CYCLES):
            found = self.mind.run(self.now, 1000)
            self.effects += found
            due = self.mind.wake_at
            if not self.mind.ready and (due is None or due > self.now):
                return self
        raise AssertionError("the mind does not come to rest")

    def at(self, now: float) -> World:
        """Go to a time, stopping at each moment in between at which the mind wants to wake."""
        self.settle()
        while self.mind.wake_at is not None and self.mind.wake_at <= now:
            self.now = max(self.now, self.mind.wake_at)
            self.settle()
        self.now = now
        return self.settle()

    def feed(self, *items: Any) -> World:
        for item in items:
            self.mind.feed(item)
        return self.settle()

    @property
    def prints(self) -> list[str]:
        return [e.text for e in self.effects if isinstance(e, Print)]

    @property
    def logs(self) -> list[str]:
        return [line_of(e) for e in self.effects if isinstance(e, Log)]

    def of(self, kind: type) -> list[Any]:
        return [e for e in self.effects if isinstance(e, kind)]


def run(source: str, **arguments: Any) -> World:
    """The world after a program has come to rest at time 0."""
    return World(mind_of(source, **arguments)).settle()
