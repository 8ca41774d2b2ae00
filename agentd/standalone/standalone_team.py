"""A team of agents in one process, without any bus: runs its minds and carries out their effects."""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import timedelta, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agentd.conversion.log_format import lines_of
from agentd.extensions.file_access import NotAllowed, allowed
from agentd.language.compiler.compile import CompiledProgram, DirectiveError
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.language.terms.terms import EMPTY, atom, make_list
from agentd.mind import Mind
from agentd.mind.data.effects import (
    AskPercepts,
    CancelAction,
    Effect,
    Log,
    PerformAction,
    Print,
    StopTeam,
    TeamRequest,
    TeamRequestRefused,
)
from agentd.mind.data.inputs import ActionDone, Mail, SignalRaised, TeamReply
from agentd.mind.data.intention import Intention, wait_text
from agentd.mind.data.registry import missing_action
from agentd.mind.execution.control_flow import Fork
from agentd.mind.introspection.failure_report import called_by
from agentd.mind.introspection.failure_text import brief, code_of, event_text, goal_text, written
from agentd.runtime.program_paths import SourcePaths
from agentd.values import literal
from commd.process.state_dir import write_output
from schemas.humanize import escape_line, escape_lines

if TYPE_CHECKING:
    from agentd.environment import Environment
    from agentd.standalone.decision_printer import DecisionPrinter
    from agentd.standalone.environment_host import EnvironmentHost

CYCLES_A_TURN = 2000
"""Cycles after which a mind without effects lets the others run."""
RUNS_A_TURN = 20
"""Runs of a mind in one turn while its effects are answered immediately, as an environment does with actions."""
SLEEP = 3600.0
"""Seconds to sleep when nothing is due: without timers nothing in this process can wake an agent."""
LONGEST_SLEEP = 1.0
"""Seconds of one sleep. A signal that arrives just before Python falls asleep is noticed when it ends."""
MOST_STUCK = 10
"""Waiting intentions that are named when a run ends; further ones are counted."""
_MOST_GOALS = 5


class WallClock:
    """Real seconds since it was made."""

    def __init__(self) -> None:
        self._begun = time.monotonic()

    def now(self) -> float:
        """Return the seconds since the beginning, 0 or more."""
        return time.monotonic() - self._begun

    def pass_time(self, seconds: float, sleep: Callable[[float], None] = time.sleep) -> None:
        """Wait for `seconds`, at most `LONGEST_SLEEP`; negative ones count as 0, and ``sleep`` may end sooner."""
        sleep(min(max(0.0, seconds), LONGEST_SLEEP))


class VirtualClock(WallClock):
    """Seconds that pass only in `pass_time`: a wait of an hour takes no time."""

    def __init__(self) -> None:
        super().__init__()
        self._now = 0.0

    def now(self) -> float:
        """Return the virtual time in seconds."""
        return self._now

    def pass_time(self, seconds: float, sleep: Callable[[float], None] = time.sleep) -> None:
        """Advance it by `seconds`, without waiting."""
        self._now += max(0.0, seconds)


class Team:
    """The agents of one run. ``out`` writes their prints, ``narrator`` their decisions when they are made.

    ``seed``, any integer, is that of the first agent's random numbers; ``decisions``, 0 or more, is the number of last
    decisions that each agent remembers.
    """

    def __init__(
        self,
        programs: list[tuple[str, CompiledProgram]],
        seed: int = 0,
        out: Callable[[str], object] | None = None,
        *,
        paths: SourcePaths | None = None,
        clock: WallClock | None = None,
        environment: Environment | None = None,
        environment_arguments: Sequence[str] = (),
        verbosity: Mapping[str, int] | None = None,
        decisions: int = 0,
        narrator: DecisionPrinter | None = None,
        folders: Sequence[Path] | None = None,
    ) -> None:
        """`folders` contain the files that programs may name at run time; None: any folder."""
        self._folders = folders
        self._verbosity = verbosity or {}
        self._paths = paths or SourcePaths()
        self.clock = clock or WallClock()
        self._epoch = time.time()
        self._world: EnvironmentHost | None = None
        if environment is not None:
            self._world = _enter(environment, self.clock, environment_arguments)
        self._write = out or sys.stdout.write
        self._decisions, self._narrator = decisions, narrator
        self._seed = seed
        self._stop: tuple[float, int] | None = None
        self._kills: list[tuple[float, str]] = []
        self._offered: list[tuple[str, str]] = []
        """Agents and the services that they offer, in the order of registration."""
        self._wanted: list[tuple[str, str]] = []
        """Agents and the services that they subscribe to."""
        self.minds: dict[str, Mind] = {}
        self._in_turn: tuple[Mind, ...] = ()
        """The same, for a turn: those that one of them creates have none in it."""
        self.failures = 0
        """Intentions that have ended by an unhandled failure, or waited in vain when the run ended."""
        try:
            for name, program in programs:
                self._add(name, program)
        except BaseException:  # such as a signal: the environment has begun and must end
            if self._world is not None:
                self._world.stop()
            raise

    def _add(self, name: str, program: CompiledProgram) -> Mind:
        zone = timezone(timedelta(seconds=time.localtime().tm_gmtoff))
        mind = self.minds[name] = Mind(
            name,
            program,
            seed=self._seed + len(self.minds),
            start=self.clock.now(),
            clock=self.clock.now,
            agents=self.minds.keys,
            has_team=True,
            epoch=self._epoch,
            zone=zone,
            decisions=self._decisions,
            on_decision=None if self._narrator is None else self._narrator.listener(name),
        )
        self._in_turn = tuple(self.minds.values())
        mind.verbose = self._verbosity.get(name, 1)
        if self._world is not None:
            self._world.join(mind)
        return mind

    def run(self, timeout: float | None, exit_when_idle: bool) -> int:
        """Run until the team stops or is idle, if asked for, at most ``timeout`` seconds (more than 0; None: no limit).

        Return the exit code: that of `.stopMAS`, 0 when idle, 1 after the timeout.
        """
        gc.collect()
        gc.freeze()
        try:
            return self._run(timeout, exit_when_idle)
        finally:
            if self._world is not None:
                self._world.stop()
            sys.stdout.flush()
            self._finish()

    def _report_stuck(self) -> None:
        """Print the intentions that wait although nothing can happen any more."""
        left = stuck(self.minds.values())
        for mind, intention in left[:MOST_STUCK]:
            self._carry_out(mind, stuck_note(intention))
        if len(left) > MOST_STUCK:
            print(f"agentd: {len(left) - MOST_STUCK} more intentions wait as these do", file=sys.stderr)
        self.failures += len(left)

    def _finish(self) -> None:
        """Print counts of dropped inputs and of decisions."""
        for mind in self.minds.values():
            for note in mind.drops.unlogged(mind.now):
                self._carry_out(mind, note)
        if self._narrator is not None:
            self._narrator.finish()

    def _run(self, timeout: float | None, exit_when_idle: bool) -> int:
        while True:
            busy = self.turns()
            now = self.clock.now()
            if self._stop is not None and self._stop[0] <= now:
                return self._stop[1]
            if timeout is not None and now >= timeout:
                print(f"agentd: not done after {timeout:g} s", file=sys.stderr)
                return 1
            if busy:
                continue
            sys.stdout.flush()
            if exit_when_idle and self.idle:
                self._report_stuck()
                return 0
            wake = min(self.due(timeout), default=now + SLEEP)
            self.pass_time(wake - now)

    @property
    def idle(self) -> bool:
        """Whether nothing is due and no action of the environment runs."""
        if self._world is not None and (self._world.waited_for or self._world.stirred):
            return False
        return not list(self.due(None))

    def pass_time(self, seconds: float) -> None:
        """Wait for `seconds` (0 or more), or until the environment has something to deliver."""
        if self._world is None:
            self.clock.pass_time(seconds)
        else:
            self.clock.pass_time(seconds, self._world.sleep)

    def turns(self) -> bool:
        """Give each mind that has something to do a turn. Return whether there was one."""
        busy = False
        world, minds, now = self._world, self.minds, self.clock.now
        if world is not None:
            world.deliver()
        in_turn = self._in_turn
        for mind in in_turn:
            if self._in_turn is not in_turn and minds.get(mind.name) is not mind:
                continue  # killed by another agent in this turn
            if not mind.ready:
                due = mind.wake_at
                if due is None or due > now():
                    continue
            busy = True
            for _ in range(RUNS_A_TURN):
                for effect in mind.run(now(), CYCLES_A_TURN):
                    if type(effect) is Mail:
                        if effect.receiver is None:
                            for other in minds.values():
                                if other is not mind:
                                    other.feed(effect)
                        elif effect.receiver in minds:
                            minds[effect.receiver].feed(effect)
                    elif type(effect) is PerformAction and world is not None:
                        world.perform(mind, effect)
                    else:
                        self._carry_out(mind, effect)
                        if minds.get(mind.name) is not mind:
                            break  # it has killed itself
                    if self._stop is not None and self._stop[0] <= now():
                        return True
                if not mind.inputs or minds.get(mind.name) is not mind:
                    break
        if self._kills:  # as a rule there are none, and a turn is short
            for due, name in [kill for kill in self._kills if kill[0] <= self.clock.now()]:
                self._kills.remove((due, name))
                self._kill(name)
        return busy

    def due(self, timeout: float | None) -> Iterator[float]:
        """Return the times at which something is due, in seconds of the clock; ``timeout`` is one of them."""
        if timeout is not None:
            yield timeout
        if self._stop is not None:
            yield self._stop[0]
        for due, _ in self._kills:
            yield due
        if self._world is not None and self._world.due is not None:
            yield self._world.due
        for mind in self.minds.values():
            if mind.wake_at is not None:
                yield mind.wake_at

    # --- effects ---

    def _carry_out(self, mind: Mind, effect: Effect) -> None:
        match effect:
            case Print(text=text, plain=plain):
                text = escape_lines(text)
                self._write(f"{text}\n" if plain else f"[{escape_line(mind.name)}] {text}\n")
            case Log(level=level):
                self.failures += effect.ends
                if level != "debug":
                    print(f"[{escape_line(mind.name)}] {escape_lines(chr(10).join(lines_of(effect)))}", file=sys.stderr)
            case PerformAction(id=number, name=name, parameters=parameters):
                if self._world is not None:
                    self._world.perform(mind, effect)
                else:
                    why = f"there is no environment that could perform {name}: name one by --env"
                    mind.feed(ActionDone(number, False, missing_action(name, len(parameters)) if "." in name else why))
            case CancelAction():
                if self._world is not None:
                    self._world.cancel(mind, effect)
            case AskPercepts():
                if self._world is not None:
                    self._world.perceive(mind)
            case StopTeam(exit_code=code, delay=delay):
                self._stop = (self.clock.now() + delay, code)
                if delay:
                    for other in self.minds.values():
                        other.feed(SignalRaised.named("jag_shutting_down", delay * 1000.0))
            case TeamRequest():
                mind.feed(self._answer(mind, effect))

    # --- requests ---

    def _answer(self, mind: Mind, request: TeamRequest) -> TeamReply:
        what, args = request.what, request.arguments
        try:
            return TeamReply(request.id, getattr(self, f"_do_{what}")(mind, *args))
        except TeamRequestRefused as no:
            return TeamReply(request.id, None, no.error, str(no))
        except (SyntaxErrors, DirectiveError) as error:
            return TeamReply(request.id, None, "unknown", str(error))

    def _free_name(self, name: str) -> str:
        number, free = 0, name
        while free in self.minds:
            number += 1
            free = f"{name}_{number}"
        return free

    def _do_create(self, mind: Mind, name: str, path: str) -> str:
        name = self._free_name(name)
        self._add(name, self._read(mind, path) if path else CompiledProgram(name))
        return name

    def _do_clone(self, mind: Mind, name: str) -> str:
        name = self._free_name(name)
        clone = self._add(name, CompiledProgram(mind.program.file))
        clone.copy_from(mind)
        if self._world is not None:
            self._world.took_over(clone, mind)
        return name

    def _read(self, mind: Mind, path: str) -> CompiledProgram:
        try:
            self._check(self._paths.find(path, mind.program.file))
            return self._paths.compiled(path, mind.program.file)
        except OSError as error:
            raise TeamRequestRefused("unknown", f"cannot read {path}: {error.strerror or error}") from error

    def _do_kill(self, mind: Mind, name: str, delay: float) -> Any:
        if name not in self.minds:
            raise TeamRequestRefused("ia_failed", f"there is no agent '{name}'")
        if delay:
            self._kills.append((self.clock.now() + delay, name))
        else:
            self._kill(name)
        return EMPTY

    def _kill(self, name: str) -> None:
        self.minds.pop(name, None)
        self._in_turn = tuple(self.minds.values())
        if self._world is not None:
            self._world.leave(name)
        self._offered = [entry for entry in self._offered if entry[0] != name]
        self._wanted = [entry for entry in self._wanted if entry[0] != name]

    def _do_df_register(self, mind: Mind, service: str) -> Any:
        if (mind.name, service) not in self._offered:
            self._offered.append((mind.name, service))
            for subscriber, wanted in self._wanted:
                if wanted == service and subscriber in self.minds:
                    self.minds[subscriber].feed(_provider(mind.name, service))
        return EMPTY

    def _do_df_deregister(self, mind: Mind, service: str) -> Any:
        self._offered = [entry for entry in self._offered if entry != (mind.name, service)]
        return EMPTY

    def _do_df_search(self, mind: Mind, service: str) -> Any:
        return make_list([atom(agent) for agent, offered in self._offered if offered == service])

    def _do_df_subscribe(self, mind: Mind, service: str) -> Any:
        if (mind.name, service) not in self._wanted:
            self._wanted.append((mind.name, service))
        for agent, offered in self._offered:
            if offered == service:
                mind.feed(_provider(agent, service))
        return EMPTY

    def _check(self, path: str) -> None:
        """Raise TeamRequestRefused for a file outside of the allowed folders."""
        try:
            if self._folders is not None and "\0" not in path:  # opening such a name raises an error of its own
                allowed(path, self._folders)
        except NotAllowed as error:
            raise TeamRequestRefused("unknown", f"{error}; allow it with --allow-folder FOLDER") from None

    def _do_save(self, mind: Mind, path: str, text: str) -> Any:
        try:
            self._check(path)
            write_output(Path(path), text.encode())
        except (OSError, ValueError) as error:  # ValueError: an invalid name, or text that UTF-8 cannot encode
            why = getattr(error, "strerror", None) or error
            raise TeamRequestRefused("unknown", f"cannot write {path}: {why}") from error
        return EMPTY

    def _do_list_files(self, mind: Mind, folder: str, pattern: str) -> Any:
        try:
            files = self._paths.files_below(folder, mind.program.file, pattern)
            for file in files:
                self._check(file)
            return make_list(files)
        except (OSError, ValueError) as error:
            raise TeamRequestRefused("unknown", f"cannot list the files of {folder}: {error}") from error

    def _do_include(self, mind: Mind, path: str, namespace: str) -> CompiledProgram | None:
        try:
            self._check(self._paths.find(path, mind.program.file))
            return self._paths.included(path, mind.program.file, namespace)
        except OSError as error:
            print(
                escape_line(f"[{mind.name}] error: cannot include {path}: {error.strerror or error}"), file=sys.stderr
            )
            return None


def _provider(agent: str, service: str) -> Mail:
    """Return the message to a subscriber: ``provider(Agent, "Service")``."""
    return Mail("df", "tell", literal("provider", atom(agent), service))


def _enter(environment: Environment, clock: WallClock, arguments: Sequence[str]) -> EnvironmentHost:
    """Begin an environment. Raises `agentd.extensions.user_code.UserCodeError`."""
    from agentd.standalone.environment_host import EnvironmentHost

    world = EnvironmentHost(environment, clock.now, lambda text: print(f"agentd: {text}", file=sys.stderr))
    world.init(list(arguments))
    return world


# --- intentions that wait when a run ends ---


def stuck(minds: Iterable[Mind]) -> list[tuple[Mind, Intention]]:
    """Return the intentions that wait or are suspended, without those that wait for branches of their own."""
    return [
        (mind, intention)
        for mind in minds
        for intention in mind.all_intentions()
        if (intention.stack or intention.held) and not isinstance(mind.waiting.get(intention.id, (None, None))[1], Fork)
    ]


def stuck_note(intention: Intention) -> Log:
    """Return the warning about an intention that nothing can resume."""
    if not intention.stack and intention.held is not None:
        return Log("warning", f"{event_text(intention.held)} was suspended before it began, and nothing resumes it")
    frames = intention.stack[::-1]
    details = [called_by(list(map(goal_text, frames[:_MOST_GOALS])), frames)]
    step = intention.last
    if step is None:
        return Log("warning", "an intention does not run any more", tuple(details))
    formula = brief(written(step, code_of(step, frames[0])))
    if intention.suspended is not None:
        text = f"the intention was suspended after {formula}, and nothing resumes it"
    else:
        text = f"{formula} waits for what cannot come any more"
        if intention.waiting is not None and intention.waiting.kind not in ("time", "formula", "event"):
            details.insert(0, f"it waits for: {wait_text(intention.waiting)}")
    return Log("warning", text, tuple(details), step.syntax.position)
