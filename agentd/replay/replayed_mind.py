"""Rebuild a mind from a recording: restore its initial state, then feed it the recorded inputs."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from agentd.language.compiler.compile import CompiledProgram, DirectiveError, compile_program
from agentd.language.parse import parse_formula
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.language.syntax_tree.nodes import Goal, Program
from agentd.mind import Mind
from agentd.mind.data.effects import Effect
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.inputs import Mail, TimeRead, TooDeep
from agentd.mind.execution.dropping import fail_too_deep
from agentd.mind.introspection.decision_log import Decision, Failure
from agentd.mind.introspection.decision_views import view_of
from agentd.mind.persistence.change_tracking import Keeper
from agentd.persistence.restore import come_back, raise_interrupted
from agentd.process import allow_deep_calls
from agentd.runtime.program_loader import goal_of, read_item, recorded_program
from agentd.trace.decision_digest import DecisionDigest, effect_text
from agentd.trace.initial_state import make_mind, parser_of, unpack, zone_of
from agentd.trace.input_records import CameBack, Given, Interrupted, MailRefused, NamesRead, Unreadable, read
from schemas.wire.mind_records import DecisionView, InitialMind, MindInputs

REMEMBERED: Final = 5_000
"""Decisions that a replayed mind remembers, to show them."""

MOST_IDLE: Final = 100_000
"""Cycles in a row without work or input: no mind counts more without noting the time."""


class CannotReplay(ValueError):
    """A recording cannot be replayed: missing batches, another version, a program that cannot be read."""


@dataclass(slots=True)
class Done:
    """A decision, a failure or an effect of a mind."""

    cycle: int
    time: float
    what: Any
    """An effect, or a record of `agentd.mind.introspection.decision_log`."""
    text: str
    """Empty for a decision: see `ReplayedMind.view_of`."""

    @property
    def line(self) -> str:
        """The cycle and the text: what digests are made of."""
        return f"{self.cycle} {self.text}"

    @property
    def decides(self) -> bool:
        """Whether it is a decision or a failure."""
        return type(self.what) in (tuple, Failure)


class ReplayedMind:
    """One replayed mind. `feed` it batch by batch; in between `mind` may be inspected."""

    def __init__(self, first: MindInputs, *, program: Mapping[str, str] | None = None) -> None:
        """`first` is batch 0; `program` has texts by path that replace recorded ones. Raises CannotReplay."""
        if first.number != 0 or first.initial is None:
            raise CannotReplay(
                f"the recording of {first.agent} begins with batch {first.number}: its initial is missing"
            )
        if first.initial.unknown:
            raise CannotReplay(f"{first.agent} cannot be replayed: {first.initial.unknown}")
        allow_deep_calls()  # as deep as in the recorded process
        self.agent, self.initial, self.number = first.agent, first.initial, -1
        self.now = first.initial.start
        self.lasts: deque[tuple[int, Given]] = deque(maxlen=5)
        """The last inputs."""
        self._done: list[Done] = []
        self._steps: deque[tuple[int, float]] = deque()
        self._given: deque[tuple[int, Given]] = deque()
        self._times: deque[float] = deque()
        self._names: tuple[str, ...] = ()
        self._refused: dict[str, MailRefused] = {}
        self._too_deep = False
        self._idle = 0
        """Cycles since the last one with work or input."""
        self._instead: Goal | None = None
        self._early = [item for item in map(_read, first.inputs) if item[0] == 0]
        for _, item in self._early:
            self._note(item)
        self.mind = self._make(first.initial, {**first.initial.files, **(program or {})})

    def _make(self, initial: InitialMind, texts: dict[str, str]) -> Mind:
        program, self._instead = program_of(initial, texts)
        try:
            zone_of(initial.zone)
            stored = unpack(initial.memory) if initial.memory else None
        except ValueError as error:
            raise CannotReplay(f"the initial state of {self.agent} cannot be read: {error}") from None
        self.keeper = Keeper(stored) if initial.kept else None
        mind = make_mind(self.agent, program, initial, self._clock, lambda: self._names, self.keeper, REMEMBERED)
        self._times.clear()
        for text in initial.formulas:
            mind.query(parse_formula(text, initial.mission))
        mind.post_office = self._send
        mind.most_frames, mind.asleep = float("inf"), None
        assert mind.recorder is not None
        mind.recorder.count_all(self._decided)
        return mind

    # --- hooks of the mind ---

    def _clock(self) -> float:
        return self._times.popleft() if self._times else self.mind.now if hasattr(self, "mind") else self.now

    def _send(self, mail: Mail) -> None:
        assert self.mind.recorder is not None
        self.mind.recorder.settle()
        if refused := self._refused.pop(mail.msg_id, None):
            raise Failed(refused.error, refused.message)
        self._did(mail)

    def _decided(self, entries: list[Any]) -> None:
        for entry in entries:
            failed = f"failure {entry.intention} {entry.failed.error}" if type(entry) is Failure else ""
            self._done.append(Done(entry[0], self.now, entry, failed))

    def _did(self, effect: Effect) -> None:
        self._done.append(Done(self.mind.cycle, self.now, effect, effect_text(effect)))

    # --- cycles ---

    def feed(self, batch: MindInputs) -> list[Done]:
        """Replay a batch; return its decisions and effects in order. Raises CannotReplay."""
        self.take(batch)
        done: list[Done] = []
        while self.mind.cycle < batch.last:
            done += self.cycle()
        self.end_of_batch()
        return done

    def take(self, batch: MindInputs) -> None:
        """Take a batch for `cycle`. Raises CannotReplay if it is not the next one."""
        if batch.agent != self.agent:
            raise CannotReplay(f"batch {batch.number} is of {batch.agent}, not of {self.agent}")
        if batch.number != self.number + 1:
            what = "is" if batch.number == self.number + 2 else f"to {batch.number - 1} are"
            raise CannotReplay(f"batch {self.number + 1} {what} missing: what went in then is not known")
        self.number = batch.number
        self._steps += [(step.first, step.now) for step in batch.steps]
        self._given += [item for item in map(_read, batch.inputs) if item[0] > 0]

    @property
    def at_boundary(self) -> bool:
        """Whether the next cycle has an input or another time."""
        cycle = self.mind.cycle + 1
        return any(queue and queue[0][0] <= cycle for queue in (self._steps, self._given))

    def cycle(self) -> list[Done]:
        """Run the next cycle as recorded; return its decisions and effects. Raises CannotReplay."""
        cycle = self.mind.cycle + 1
        while self._steps and self._steps[0][0] <= cycle:
            self.now = self._steps.popleft()[1]
        items: list[Given] = []
        while self._given and self._given[0][0] <= cycle:
            self.lasts.append(self._given[0])
            items.append(self._given.popleft()[1])
        for item in items:
            self._note(item)
        for item in items:
            self._give(item)
        self._idle = 0 if items or self.mind.ready else self._idle + 1
        if self._idle > MOST_IDLE:
            raise CannotReplay(f"batch {self.number} of {self.agent} counts cycles in which nothing can have happened")
        return self._run()

    def go_on(self, cycles: int) -> list[Done]:
        """Run up to `cycles` cycles beyond the recording, while there is something to do."""
        done: list[Done] = []
        while cycles and self.mind.ready:
            cycles -= 1
            done += self._run()
        return done

    def _run(self) -> list[Done]:
        mind = self.mind
        effects = mind.run(self.now, 1)
        if self._too_deep and mind.current is not None:
            fail_too_deep(mind, mind.current)
            effects, mind.effects = effects + mind.effects, []
        assert mind.recorder is not None
        mind.recorder.settle()
        for effect in effects:
            self._did(effect)
        self._times.clear()
        self._refused.clear()
        self._too_deep = False
        done, self._done = self._done, []
        return done

    def end_of_batch(self) -> None:
        """Discard changes that would be saved."""
        if self.keeper is not None:
            self.keeper.changes()

    def _note(self, item: Given) -> None:
        """Prepare what the mind will read in this cycle."""
        match item:
            case TimeRead(seconds=seconds):
                self._times.append(seconds)
            case NamesRead(names=names):
                self._names = names
            case MailRefused(msg_id=identity):
                self._refused[identity] = item
            case TooDeep():
                self._too_deep = True

    def _give(self, item: Given) -> None:
        """Give the mind an input."""
        match item:
            case CameBack(life=life, interrupted=interrupted):
                if self.keeper is not None:
                    come_back(self.mind, self.keeper, life, interrupted, self._instead)
            case Interrupted(literal=literal):
                if self.keeper is not None:
                    raise_interrupted(self.mind, self.keeper, literal)
            case TimeRead() | NamesRead() | MailRefused() | TooDeep():
                pass
            case _:
                self.mind.feed(item)

    def view_of(self, decision: Done) -> DecisionView:
        """Return a decision with its rejected plans."""
        view = view_of(self.mind, Decision(*decision.what))
        assert isinstance(view, DecisionView)
        return view


def _read(record: Any) -> tuple[int, Given]:
    try:
        return record.cycle, read(record)
    except Unreadable as bad:
        raise CannotReplay(str(bad)) from None


def digest_of(done: Iterable[Done], decisions: bool) -> tuple[int, str]:
    """Return the number of acts and their digest; without `decisions` those of effects only."""
    acts, rest = DecisionDigest(), list(done)
    if decisions:
        acts.decided(one.what for one in rest if one.decides)
    for one in rest:
        if not one.decides:
            acts.did(one.line)
    return acts.take()


def program_of(initial: InitialMind, texts: Mapping[str, str]) -> tuple[CompiledProgram, Goal | None]:
    """Compile a program from recorded texts; return it with the goal of a restart. Raises CannotReplay."""
    read = parser_of(texts)
    try:
        main = read(initial.program) if initial.program else Program("")
        program = recorded_program(main, initial.beliefs, initial.goals, initial.mission)
        instead = None
        if initial.on_restart:
            found = read_item(goal_of(initial.on_restart), initial.mission, Goal)[0]
            instead = found if isinstance(found, Goal) else None
        return compile_program(program, read), instead
    except SyntaxErrors as errors:
        raise CannotReplay(str(errors.findings[0])) from None
    except (DirectiveError, OSError, ValueError) as error:
        raise CannotReplay(f"the program cannot be read: {error}") from None
