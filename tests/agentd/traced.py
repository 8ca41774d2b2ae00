"""Minds without a bus whose course is noted, as a host does it, and lived again from that as from a recording."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from agentd.language.compiler.compile import CompiledProgram, compile_program
from agentd.language.parse import parse_program
from agentd.mind import Mind
from agentd.mind.data.effects import Effect
from agentd.trace.initial_state import InitialState, Sources
from agentd.trace.input_log import InputBatch, InputLog
from schemas.wire.codec import codec
from schemas.wire.mind_records import InitialMind, MindInputs


class OpenMind(Mind):
    """A mind whose methods a test may replace."""


class Traced:
    """A mind whose course is noted from its birth; `batches` is what a recorder has at the end."""

    def __init__(
        self,
        name: str,
        program: CompiledProgram,
        sources: Sources,
        *,
        start: float = 0.0,
        seed: int = 0,
        epoch: float = 0.0,
        agents: Collection[str] = (),
        decisions: int = 200,
        listened: bool = True,
        **arguments: Any,
    ) -> None:
        settings = InitialMind(program="", decisions=decisions, seed=seed, start=start, epoch=epoch)
        self.start = start
        self.initial = InitialState(settings, sources)
        self.course = InputLog(name, self.initial.record, lambda: tuple(agents))
        self.mind = mind = OpenMind(
            name,
            program,
            start=start,
            seed=seed,
            epoch=epoch,
            agents=self.course.names,
            has_team=True,
            decisions=decisions,
            on_input=self.course.given,
            **arguments,
        )
        self.course.follow(mind)
        self._batches: list[InputBatch] = []
        if listened:
            self.course.listen(self._batches.append)
            if mind.recorder is not None:
                mind.recorder.count_all(self.course.decided)
        self._run = mind.run
        mind.run = self.run  # type: ignore[method-assign]

    @staticmethod
    def of(source: str, name: str = "bob", **arguments: Any) -> Traced:
        """A mind with a program given as text."""
        sources = Sources(main=f"{name}.asl")
        sources.keep(sources.main, source)
        return Traced(name, compile_program(parse_program(source, sources.main)), sources, **arguments)

    def run(self, now: float, cycles: int) -> list[Effect]:
        """Run cycles of the mind, as its host does."""
        first = self.mind.cycle + 1
        effects = self._run(now, cycles)
        if self.mind.recorder is not None:
            self.mind.recorder.settle()
        for effect in effects if self.course.listened else ():
            self.course.did(self.mind.cycle, effect)
        self.course.ran(first, now)
        return effects

    @property
    def batches(self) -> list[MindInputs]:
        """All batches, having crossed the wire."""
        self.course.flush()
        made = codec(MindInputs)
        return [made.decode(made.encode(self.course.record(batch))) for batch in self._batches]
