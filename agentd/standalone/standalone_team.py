"""A team of agents in one process, without any bus: what carries out the effects of its minds."""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
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
    SendMail,
    StopTeam,
    TeamRequest,
    TeamRequestRefused,
)
from agentd.mind.data.inputs import ActionDone, Mail, SignalRaised, TeamReply
from agentd.mind.data.registry import missing_action
from agentd.runtime.program_paths import SourcePaths
from agentd.standalone.clocks import WallClock
from agentd.standalone.deadlock_report import MOST_TOLD, stuck, stuck_note
from agentd.standalone.service_directory import Directory, provider
from schemas.humanize import escape_line, escape_lines

if TYPE_CHECKING:
    from agentd.environment import Environment
    from agentd.environment.environment_host import World
    from agentd.standalone.decision_printer import DecisionPrinter

CYCLES_A_TURN = 2000
"""A mind with nothing to hand out gives way to the others after so many cycles."""

RUNS_A_TURN = 20
"""A mind whose effects are answered at once, as actions are by an environment, goes on so often before the others."""

SLEEP = 3600.0
"""Without timers nothing in this process can wake an agent: so long a sleep, in seconds, is as good as any."""


class Team:
    """The agents of one run. ``out`` takes what they print; ``seed`` starts the random numbers of the first.

    ``decisions`` is how many of its last decisions each remembers, ``narrator`` tells them as they are made.
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
        """`folders` are those that the files which programs name at run time must be in; None: any."""
        self._folders = folders
        self._verbosity = verbosity or {}
        self._paths = paths or SourcePaths()
        self.clock = clock or WallClock()
        self._epoch = time.time()
        self._world: World | None = None
        if environment is not None:
            self._world = _enter(environment, self.clock, environment_arguments)
        self._write = out or sys.stdout.write
        self._decisions, self._narrator = decisions, narrator
        self._seed = seed
        self._stop: tuple[float, int] | None = None
        self._kills: list[tuple[float, str]] = []
        self._directory = Directory()
        self.minds: dict[str, Mind] = {}
        self.failures = 0
        """How many intentions have ended by a failure that nothing handled, or were stuck when the run ended."""
        try:
            for name, program in programs:
                self._add(name, program)
        except BaseException:  # a signal, say: the environment has begun and must end
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
        mind.verbose = self._verbosity.get(name, 1)
        if self._world is not None:
            self._world.join(mind)
        return mind

    def run(self, timeout: float | None, exit_when_idle: bool) -> int:
        """Run until the team stops (its exit code), is idle (0), or ``timeout`` seconds are over (1)."""
        gc.collect()
        gc.freeze()
        try:
            return self._run(timeout, exit_when_idle)
        finally:
            if self._world is not None:
                self._world.stop()
            sys.stdout.flush()
            self._finish()

    def _tell_stuck(self) -> None:
        """Tell which intentions are left when nothing can happen any more."""
        left = stuck(self.minds.values())
        for mind, intention in left[:MOST_TOLD]:
            self._carry_out(mind, stuck_note(intention))
        if len(left) > MOST_TOLD:
            print(f"agentd: {len(left) - MOST_TOLD} more intentions wait as these do", file=sys.stderr)
        self.failures += len(left)

    def _finish(self) -> None:
        """Tell what is left to be told."""
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
                self._tell_stuck()
                return 0
            wake = min(self.due(timeout), default=now + SLEEP)
            self.pass_time(wake - now)

    @property
    def idle(self) -> bool:
        """Whether nothing can happen any more of itself: nothing is due and no action of the environment runs."""
        if self._world is not None and (self._world.waited_for or self._world.stirred):
            return False
        return not list(self.due(None))

    def pass_time(self, seconds: float) -> None:
        """Wait so long, or until the environment stirs."""
        if self._world is None:
            self.clock.pass_time(seconds)
        else:
            self.clock.pass_time(seconds, self._world.sleep)

    def turns(self) -> bool:
        """Let each mind that has something to do run for a while; whether there was one."""
        busy = False
        if self._world is not None:
            self._world.deliver()
        for mind in tuple(self.minds.values()):
            if not self._lives(mind):
                continue  # another one has killed it in this turn
            if not mind.ready:
                due = mind.wake_at
                if due is None or due > self.clock.now():
                    continue
            busy = True
            for _ in range(RUNS_A_TURN):
                for effect in mind.run(self.clock.now(), CYCLES_A_TURN):
                    if type(effect) is SendMail:
                        self._send(mind, effect)
                    elif type(effect) is PerformAction and self._world is not None:
                        self._world.perform(mind, effect)
                    else:
                        self._carry_out(mind, effect)
                        if not self._lives(mind):
                            break  # what it would have done after it has killed itself is not done
                    if self._stop is not None and self._stop[0] <= self.clock.now():
                        return True
                if not mind.inputs or not self._lives(mind):
                    break
        if self._kills:
            self._kill_those_due()
        return busy

    def _lives(self, mind: Mind) -> bool:
        return self.minds.get(mind.name) is mind

    def _kill_those_due(self) -> None:
        for due, name in [k for k in self._kills if k[0] <= self.clock.now()]:
            self._kills.remove((due, name))
            self._kill(name)

    def due(self, timeout: float | None) -> Iterator[float]:
        """The times at which something has to happen."""
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
                    why = f"there is no environment that could perform {name}"
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

    def _send(self, mind: Mind, mail: SendMail) -> None:
        sent = Mail(mind.name, mail.performative, mail.content, mail.msg_id, mail.in_reply_to)
        if mail.receiver is None:
            for receiver in self.minds.values():
                if receiver is not mind:
                    receiver.feed(sent)
        else:
            addressee = self.minds.get(mail.receiver)
            if addressee is not None:
                addressee.feed(sent)

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
        program = CompiledProgram(name)
        if path:
            program = self._read(mind, path)
        self._add(name, program)
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
        if self._world is not None:
            self._world.leave(name)
        self._directory.forget(name)

    def _do_df_register(self, mind: Mind, service: str) -> Any:
        for subscriber in self._directory.register(mind.name, service):
            told = self.minds.get(subscriber)
            if told is not None:
                told.feed(Mail("df", "tell", provider(mind.name, service)))
        return EMPTY

    def _do_df_deregister(self, mind: Mind, service: str) -> Any:
        self._directory.deregister(mind.name, service)
        return EMPTY

    def _do_df_search(self, mind: Mind, service: str) -> Any:
        return make_list([atom(name) for name in self._directory.search(service)])

    def _do_df_subscribe(self, mind: Mind, service: str) -> Any:
        for agent in self._directory.subscribe(mind.name, service):
            mind.feed(Mail("df", "tell", provider(agent, service)))
        return EMPTY

    def _check(self, path: str) -> None:
        """Raise TeamRequestRefused for a file out of the folders that programs may name files in at run time."""
        try:
            if self._folders is not None and "\0" not in path:  # no file has such a name: who opens it says so
                allowed(path, self._folders)
        except NotAllowed as error:
            raise TeamRequestRefused("unknown", f"{error}; allow it with --allow-folder FOLDER") from None

    def _do_save(self, mind: Mind, path: str, text: str) -> Any:
        try:
            self._check(path)
            Path(path).write_text(text, encoding="utf-8")
        except OSError as error:
            raise TeamRequestRefused("unknown", f"cannot write {path}: {error.strerror or error}") from error
        except ValueError as error:  # a name that no file can have, or a text that UTF-8 cannot write
            raise TeamRequestRefused("unknown", f"cannot write {path}: {error}") from error
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


def _enter(environment: Environment, clock: WallClock, arguments: Sequence[str]) -> World:
    """Begin an environment. Raises `agentd.extensions.user_code.UserCodeError`."""
    from agentd.environment.environment_host import World

    world = World(environment, clock.now, lambda text: print(f"agentd: {text}", file=sys.stderr))
    world.init(list(arguments))
    return world
