"""``agentd run``: agents in one process, without any bus, for trying programs out."""

from __future__ import annotations

import argparse
import gc
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from agentd.language.compile import CompiledProgram, DirectiveError, compile_program
from agentd.language.errors import SyntaxErrors
from agentd.language.parser import parse_file
from agentd.mind import Mind
from agentd.mind.effects import CancelAction, Effect, Log, PerformAction, Print, SendMail, StopTeam
from agentd.mind.inputs import ActionDone, Mail, SignalRaised

CYCLES_A_TURN = 2000
"""A mind with nothing to hand out gives way to the others after so many cycles."""

DEEPEST_CALLS = 9000
"""How deep rules may call one another; a computation beyond fails its plan."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of the command."""
    parser.add_argument("agents", nargs="+", metavar="[NAME=]FILE.asl", help="an agent; its name is the file's if none")
    parser.add_argument("--exit-when-idle", action="store_true", help="end when no agent has anything left to do")
    parser.add_argument("--timeout", type=float, metavar="S", help="end with exit code 1 after so many seconds")
    parser.add_argument("--seed", type=int, default=0, help="start of the random numbers (default 0)")


def run(args: argparse.Namespace) -> int:
    """Run the agents; the exit code as the command's contract says."""
    sys.setrecursionlimit(max(sys.getrecursionlimit(), DEEPEST_CALLS))
    try:
        programs = [_read(argument) for argument in args.agents]
    except _Refused as refused:
        print(refused, file=sys.stderr)
        return 2
    names = [name for name, _ in programs]
    for name in names:
        if names.count(name) > 1:
            print(f"two agents are called '{name}'; give them names: NAME=FILE.asl", file=sys.stderr)
            return 2
    return Team(programs, args.seed).run(args.timeout, args.exit_when_idle)


class _Refused(Exception):
    """A program that cannot be read, told."""


def _read(argument: str) -> tuple[str, CompiledProgram]:
    name, equals, path = argument.partition("=")
    if not equals:
        name, path = Path(argument).stem, argument
    try:
        program = parse_file(path)
        return name, compile_program(program, lambda included: parse_file(included))
    except OSError as error:
        raise _Refused(f"{path}: error: cannot read the program: {error.strerror or error}") from error
    except (SyntaxErrors, DirectiveError) as error:
        raise _Refused(str(error)) from error
    except UnicodeDecodeError as error:
        raise _Refused(f"{path}: error: the program is not UTF-8 text") from error


class Team:
    """The agents of one run."""

    def __init__(
        self, programs: list[tuple[str, CompiledProgram]], seed: int, out: Callable[[str], object] | None = None
    ) -> None:
        self._begun = time.monotonic()
        self._write = out or sys.stdout.write
        self._stop: tuple[float, int] | None = None
        epoch, zone = time.time(), time.localtime().tm_gmtoff
        from datetime import timedelta, timezone

        self.minds: dict[str, Mind] = {}
        for number, (name, program) in enumerate(programs):
            self.minds[name] = Mind(
                name,
                program,
                seed=seed + number,
                clock=self._clock,
                agents=lambda: tuple(self.minds),
                epoch=epoch,
                zone=timezone(timedelta(seconds=zone)),
            )

    def _clock(self) -> float:
        return time.monotonic() - self._begun

    def run(self, timeout: float | None, exit_when_idle: bool) -> int:
        """Run until the team stops, is idle, or the time is over."""
        gc.collect()
        gc.freeze()
        while True:
            busy = False
            for mind in list(self.minds.values()):
                due = mind.wake_at
                if mind.ready or (due is not None and due <= self._clock()):
                    busy = True
                    for effect in mind.run(self._clock(), CYCLES_A_TURN):
                        self._carry_out(mind, effect)
                        if self._stop is not None and self._stop[0] <= self._clock():
                            sys.stdout.flush()
                            return self._stop[1]
            now = self._clock()
            if self._stop is not None and self._stop[0] <= now:
                sys.stdout.flush()
                return self._stop[1]
            if timeout is not None and now >= timeout:
                sys.stdout.flush()
                print(f"agentd: not done after {timeout:g} s", file=sys.stderr)
                return 1
            if busy:
                continue
            sys.stdout.flush()
            wake = min(self._due(timeout), default=None)
            if exit_when_idle and all(m.wake_at is None for m in self.minds.values()) and self._stop is None:
                return 0
            # Without timers, nothing in this process can wake an agent any more: sleep until a signal.
            time.sleep(3600.0 if wake is None else max(0.0, wake - now))

    def _due(self, timeout: float | None) -> Iterator[float]:
        if timeout is not None:
            yield timeout
        if self._stop is not None:
            yield self._stop[0]
        for mind in self.minds.values():
            if mind.wake_at is not None:
                yield mind.wake_at

    def _carry_out(self, mind: Mind, effect: Effect) -> None:
        match effect:
            case Print(text=text):
                self._write(f"[{mind.name}] {text}\n")
            case Log(level=level, text=text):
                if level != "debug":
                    print(f"[{mind.name}] {level}: {text}", file=sys.stderr)
            case SendMail():
                self._send(mind, effect)
            case PerformAction(id=number, name=name):
                reason = f"there is no environment that could perform {name}"
                mind.feed(ActionDone(number, False, reason))
            case CancelAction():
                pass
            case StopTeam(exit_code=code, delay=delay):
                self._stop = (self._clock() + delay, code)
                if delay:
                    for other in self.minds.values():
                        other.feed(SignalRaised.named("jag_shutting_down", delay * 1000.0))

    def _send(self, mind: Mind, mail: SendMail) -> None:
        if mail.receiver is None:
            receivers = [other for other in self.minds.values() if other is not mind]
        else:
            receivers = [other for other in self.minds.values() if other.name == mail.receiver]
        for receiver in receivers:
            receiver.feed(Mail(mind.name, mail.performative, mail.content, mail.msg_id, mail.in_reply_to))
