"""Run a daemon as a process: signals, logs, health records and an exit code."""

from __future__ import annotations

import asyncio
import logging
import os
import resource
import signal
import threading
import time
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import Any, Final, TypeAlias

from msgspec.structs import replace

from commd.bus.bus import Bus
from commd.bus.errors import AlreadyRunning, BusClosed, OtherMajor, QueryFailed
from commd.bus.session import sessions_under_way, still_there
from commd.bus.tls import Tls, tls_in
from commd.common.clock import Clock
from commd.common.wakeup_coalescing import CoalescingLoop, loop_lag
from commd.process.log_handler import begin_logging, handler_of_this_process, one_line
from commd.process.output import ERROR, flush, stderr
from commd.process.restart_counter import note_ends
from commd.process.user_code import where
from schemas.files.findings import Findings
from schemas.files.text_files import MAY_PASS
from schemas.files.units import check_endpoint
from schemas.liveness import HEALTH_EVERY
from schemas.version import RELEASE
from schemas.wire import keys
from schemas.wire.codec import BadRecord, Wire, codec
from schemas.wire.records import VERSION, AgentHealth, BoardServices, Health, Note

NOTES = 50
"""Warnings of one health record, or of one agent in it; further ones are left out."""
ROOM = 20_000
"""Counters and notes of all agents in one health record; further ones are left out and counted: about 500 kB."""
GREETING = 2.0
"""Wall seconds for a board's commd to answer with its version."""
LINGER = 1.0
"""Wall seconds for non-daemon threads after the daemon has ended."""
log = logging.getLogger("process")

EXIT_DONE, EXIT_FAILED, EXIT_BAD_INPUT = 0, 1, 2


def add_router_argument(parser: ArgumentParser) -> None:
    """Declare `--router` and `--keys`, which every daemon has."""
    help_ = "Zenoh endpoint of the router (default: the mission's)"
    parser.add_argument("--router", metavar="ENDPOINT", type=endpoint_argument, help=help_)
    parser.add_argument("--keys", metavar="FOLDER", type=Path, help="keys of this machine, for tls/ endpoints")


def tls_of(args: Namespace) -> Tls | None:
    """Return the keys of `--keys`. Raises Findings for keys that nobody would accept."""
    return None if args.keys is None else tls_in(args.keys)


def endpoint_argument(text: str) -> str:
    """Check an endpoint on the command line."""
    try:
        return check_endpoint(text)
    except ValueError as error:
        raise ArgumentTypeError(str(error)) from None


def on_end_signals(end: Callable[[signal.Signals], object], *numbers: signal.Signals) -> list[signal.Signals]:
    """Call `end` at SIGINT, SIGTERM and SIGHUP (terminal or ssh connection closed), or at the given signals.

    A SIGHUP that the parent process has set to be ignored (``nohup``) stays ignored. Returns the signals that are
    handled; outside of the main thread none: the caller handles them."""
    loop, handled = asyncio.get_running_loop(), list[signal.Signals]()
    for number in numbers or (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            with suppress(RuntimeError, ValueError):  # not in the main thread
                loop.add_signal_handler(number, end, number)
                handled.append(number)
    return handled


def run_daemon(name: str, main: Callable[[asyncio.Event], Awaitable[int]]) -> int:
    """Run a daemon's `main(stop)` until it returns, and return its exit code.

    A signal that ends it (`on_end_signals`) sets `stop`. If non-daemon threads outlive it, the process ends here."""
    code = _run(name, main)
    end_with_threads(code)
    return code


def _run(name: str, main: Callable[[asyncio.Event], Awaitable[int]]) -> int:
    logs = begin_logging(name)

    async def supervised() -> int:
        stop = asyncio.Event()
        asyncio.get_running_loop().set_exception_handler(_defect)
        on_end_signals(lambda _: stop.set())
        return await main(stop)

    def aborted(words: str) -> None:
        stderr().write(f"error: {name}: {words}", ERROR)
        note_ends(one_line(words))
        flush()

    words = ""
    report_abort(aborted)
    try:
        with asyncio.Runner(loop_factory=CoalescingLoop) as runner:
            code = runner.run(supervised())
        if code != EXIT_DONE:
            error = logs.last_error("")
            words = error.text if error is not None else f"exit code {code}"
        return code
    except Findings as findings:
        words = str(findings)
        stderr().write(words, ERROR)
        return EXIT_BAD_INPUT
    except (AlreadyRunning, BusClosed, OtherMajor) as error:
        words = str(error)
        stderr().write(f"error: {name}: {error}", ERROR)
        return EXIT_FAILED
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:  # a panic of Zenoh's is no Exception
        full = isinstance(error, OSError) and error.errno in MAY_PASS
        words = f"the system refuses: {error}" if full else f"defect in argosy: {type(error).__name__}: {error}"
        if os.environ.get("ARGOSY_DEBUG"):
            raise
        stderr().write(f"error: {name}: {words}" + ("" if full else "; ARGOSY_DEBUG=1 shows where"), ERROR)
        return EXIT_FAILED
    finally:
        note_ends(one_line(words))
        logs.end_window()
        flush()


def end_with_threads(code: int, seconds: float = LINGER) -> None:
    """End the process here, without the interpreter's shutdown, if threads that would delay or abort that are left
    after `seconds` (wall).

    Threads of an extension must not outlive the daemon; Zenoh's opening and closing of sessions must not be aborted.
    """
    others = [one for one in threading.enumerate() if not one.daemon and one is not threading.main_thread()]
    if left := still_there([*others, *sessions_under_way()], seconds):
        if any(one in others for one in left):
            log.warning("ending although threads still run: %s", ", ".join(one.name for one in left))
        flush()
        os._exit(code)


def _defect(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Log an uncaught error in one line; with `ARGOSY_DEBUG=1` with its traceback."""
    error = context.get("exception")
    what = f"{type(error).__name__}: {error}" if error is not None else context["message"]
    log.error("defect in argosy: %s", what, exc_info=error if os.environ.get("ARGOSY_DEBUG") else None)


async def greet(bus: Bus, boards: Iterable[str]) -> None:
    """Query the commd of each board for its services, to compare versions. Raises OtherMajor.

    One that does not answer may not run yet: its later records are noted by `Strangers`.
    """
    for board in dict.fromkeys(boards):
        key = keys.services(bus.fleet, board)
        try:
            await bus.ask_one(key, None, BoardServices, GREETING)
        except QueryFailed as failed:
            if failed.other_version:
                raise OtherMajor(
                    f"the commd of board `{board}` speaks version {failed.other_version} of the records,"
                    f" this {bus.daemon} version {VERSION}: install the same release of Argosy for all of a board"
                ) from None


GRID: Final = 0.25
"""Wall seconds; health records are put at multiples of this, when other tasks of the process wake as well."""

Agents: TypeAlias = Mapping[str, Callable[[], AgentHealth]]
"""What returns the health of each agent."""


async def report_health(
    bus: Bus,
    name: str,
    clock: Clock,
    details: Callable[[], Health] = Health,
    agents: Callable[[], Agents] = dict,
) -> None:
    """Publish the daemon's health once a second, for ever: others judge by it whether the daemon hangs.

    `agents()` returns those of an `agentd` that live on the board `name`.
    """
    while True:
        try:
            health = details()
        except Exception as error:  # a defect in a figure must not end the health records
            health = Health(notes=_defect_note(name, error))
        used = resource.getrusage(resource.RUSAGE_SELF)
        words, age, errors = _last_error(bus, name)
        unknown = bus.counters["unknown_fields"]  # of records of a newer sender
        denied = [Note("access_denied", bus.access.note)] if bus.access.note else []
        notes = (*health.notes, *bus.strangers.notes(), *denied)
        record = Health(
            header=bus.header("health", name),
            daemon=bus.daemon,
            pid=os.getpid(),
            uptime=round(clock.wall(), 1),
            cpu=round(used.ru_utime + used.ru_stime, 3),
            drops=bus.counters["dropped"] + health.drops,
            bad_input=bus.counters["bad_input"] + health.bad_input,
            counters={**health.counters, **({"unknown_fields": float(unknown)} if unknown else {})},
            percepts=health.percepts,
            ordered=health.ordered,
            notes=_printable(notes),
            version=RELEASE,
            restarts=bus.restarts,
            lag=round(max(loop_lag(), health.lag), 3),
            errors=errors,
            last_error=words,
            last_error_age=age,
            idle=health.idle,
            paused=health.paused,
        )
        record = _with_agents(record, agents())
        if bad := _unreadable(record, bus.wire):
            bus.counters["unsendable"] += 1
            log.error("health of %s cannot be sent: %s", name, bad)
            plain = {field: getattr(record, field) for field in ("header", "daemon", "pid", "uptime", "cpu", "version")}
            bare = {agent: AgentHealth(idle=its.idle, robot=its.robot) for agent, its in record.agents.items()}
            note = Note("health_unsendable", one_line(f"its health cannot be sent: {bad}"))
            record = Health(**plain, notes=(note,), agents=bare)
        bus.put(keys.health(bus.fleet, name, bus.daemon), record, urgent=True)
        await asyncio.sleep(HEALTH_EVERY - asyncio.get_running_loop().time() % GRID)  # when others wake as well


def _with_agents(health: Health, agents: Agents) -> Health:
    """Return the record of a daemon with the health of its agents, which is limited to `ROOM`."""
    logs = handler_of_this_process()
    found: dict[str, AgentHealth] = {}
    room, left_out = ROOM, 0
    for name, health_of in agents.items():
        try:
            its = health_of()
        except Exception as error:  # must not end the health records of the others
            its = AgentHealth(notes=_defect_note(name, error))
        if its.notes:
            its = replace(its, notes=_printable(its.notes))
        if logs is not None and (newest := logs.error_about(name)) is not None:
            its = replace(its, last_error=newest.text, last_error_age=round(time.monotonic() - newest.at, 1))
        size = len(its.counters) + len(its.notes)
        if size > room:
            its, left_out = replace(its, counters={}, notes=()), left_out + size
        else:
            room -= size
        found[name] = its
    return replace(health, agents=found, left_out=left_out) if found else health


def _defect_note(name: str, error: Exception) -> tuple[Note, ...]:
    log.error("defect in argosy: health of %s", name, exc_info=error)
    return (Note("defect", f"defect in argosy: {type(error).__name__}: {error}", "health"),)


def _printable(notes: Sequence[Note]) -> tuple[Note, ...]:
    return tuple(replace(note, text=one_line(note.text), about=one_line(note.about)) for note in notes[:NOTES])


def _unreadable(health: Health, wire: Wire) -> str:
    """Return why a health record cannot be read by others; empty if it can."""
    made = codec(Health)
    try:
        made.decode(made.encode(health, wire), made.encodings[wire])
    except BadRecord as bad:
        return str(bad)
    return ""


def _last_error(bus: Bus, name: str) -> tuple[str, float | None, int]:
    """Return the newest error about this name, its age in seconds, and the number of all errors."""
    logs = handler_of_this_process()
    error = logs.last_error(name) if logs is not None else None
    if logs is not None and error is not None:
        return error.text, round(time.monotonic() - error.at, 1), logs.errors
    return bus.former_failure, None, 0


def report_abort(report: Callable[[str], None]) -> None:
    """Call `report(text)` at SIGABRT, which a watchdog sends, then end by it.

    Python calls it, so not while C code hangs; then the process just ends.
    """

    def aborted(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGABRT, signal.SIG_DFL)
        try:
            report(f"ended by SIGABRT, as by a watchdog, {where(frame)}")
        finally:
            os.kill(os.getpid(), signal.SIGABRT)

    signal.signal(signal.SIGABRT, aborted)
