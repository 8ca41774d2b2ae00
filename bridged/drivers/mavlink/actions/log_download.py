"""Download a log of the vehicle: `.bin` of ArduPilot, `.ulg` of PX4 (MAVLink LOG_REQUEST_LIST and LOG_REQUEST_DATA).

The vehicle sends pieces of 90 bytes and repeats nothing: what is missing of a window is requested again. The file
appears when all of it is on disk, under a name of ours.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Generator, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from io import FileIO
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Outcome
from bridged.drivers.mavlink.actions.context import BoundAction, Ended, Part, ProcedureContext, ProcedureRun, Steps
from commd.process.state_dir import make_private_folder
from schemas.humanize import size

MAX_BYTES = 2**30
"""Of one log; at 57,600 baud it would take two days and a half."""
SPARE_BYTES = 64 * 2**20
"""Bytes that stay free on the disk: mail and the action log are there too."""
MAX_LOGS = 2000
"""In the list; ArduPilot stores 500 at most."""
PIECE, WINDOW = 90, 512 * 90
"""Bytes of a LOG_DATA, and of what is requested together."""
TRIES = 8
QUIET = (1.0, 1.0)
"""Mission and wall seconds of silence after which what is missing is requested again."""
FLUSH_STEP = 0.002
"""Wall seconds for which a step waits for the disk."""
LATEST = -1
"""The argument that means the latest log."""
SUFFIXES = {dialect.MAV_AUTOPILOT_ARDUPILOTMEGA: ".bin", dialect.MAV_AUTOPILOT_PX4: ".ulg"}
"""By MAV_AUTOPILOT."""


def download_log(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """`log_download`: every byte of the log that the vehicle lists is in a file, whose path is the reason."""
    wanted = action.arguments.get("log", LATEST)
    if not isinstance(wanted, int) or isinstance(wanted, bool):
        return Outcome("refused", f"a log is a whole number, or {LATEST} for the latest, got {wanted!r}", "request")
    if flight.vehicle.armed:
        return Outcome("refused", _armed(flight))
    with _reserved(flight, run):
        entry = yield from _find(flight, run, wanted)
        _check_size(flight, entry)
        try:
            path = yield from _save(flight, run, entry)
        except OSError as error:
            raise Ended("failed", f"{error.filename or 'the log'}: {error.strerror}", "storage") from None
    return Outcome("succeeded", f"log {entry.id}, {size(entry.size)}, is in {path}")


@contextmanager
def _reserved(flight: ProcedureContext, run: ProcedureRun) -> Iterator[None]:
    """Reserve the log protocol for one action, and let the vehicle log again at its end, whatever that is."""
    if flight.downloading:
        raise Ended("refused", f"busy: {flight.downloading} is downloading a log", "busy")
    flight.downloading = run.name
    try:
        yield
    finally:
        flight.downloading = ""
        flight.send(dialect.MAVLink_log_request_end_message(*flight.addressee))


def _armed(flight: ProcedureContext) -> str:
    return f"a log is downloaded disarmed: in flight the vehicle writes it and needs its link; {flight.state_text()}"


def _look(flight: ProcedureContext) -> Part:
    """Wait for the next message. Raises Ended if the vehicle is armed."""
    yield
    if flight.vehicle.armed:
        raise Ended("failed", _armed(flight))


def _find(
    flight: ProcedureContext, run: ProcedureRun, wanted: int
) -> Generator[None, None, dialect.MAVLink_log_entry_message]:
    """Return the list's entry of a log. Raises Ended if there is none, or if the list does not arrive as a whole.

    The list is heard to its end in any case: ArduPilot ignores what is requested meanwhile.
    """
    entries: dict[int, dialect.MAVLink_log_entry_message] = {}
    count = None
    for _ in range(TRIES):
        flight.send(dialect.MAVLink_log_request_list_message(*flight.addressee, 0, 0xFFFF))
        until = flight.now + flight.wait(*QUIET)
        while flight.now <= until and (count is None or len(entries) < count):
            run.waits_for = f"the list of logs; {len(entries)} of {'?' if count is None else count} entries came"
            yield from _look(flight)
            entry = flight.message
            if not isinstance(entry, dialect.MAVLink_log_entry_message):
                continue
            count = entry.num_logs
            if not count:
                raise Ended("failed", "the vehicle has no logs")
            if count > MAX_LOGS:
                raise Ended("failed", f"the vehicle lists {count} logs; {MAX_LOGS} are read at most: erase some")
            entries[entry.id] = entry
            until = flight.now + flight.wait(*QUIET)
        if len(entries) == count or wanted in entries:
            return _chosen(entries, wanted)
    came = f"{len(entries)} of {count} entries came" if count else f"asked {TRIES} times"
    raise Ended("failed", f"the vehicle did not send the list of its logs, {came}")


def _chosen(entries: dict[int, dialect.MAVLink_log_entry_message], wanted: int) -> dialect.MAVLink_log_entry_message:
    """Return a log by its id, or the latest: by its time, or the last of the list where a time is not known."""
    if wanted == LATEST:
        known = list(entries.values())
        if all(entry.time_utc for entry in known):
            return max(known, key=lambda entry: (entry.time_utc, entry.id))
        return entries.get(known[0].last_log_num, max(known, key=lambda entry: int(entry.id)))
    if wanted in entries:
        return entries[wanted]
    raise Ended("failed", f"the vehicle has no log {wanted}; it has {min(entries)} to {max(entries)}")


def _check_size(flight: ProcedureContext, entry: dialect.MAVLink_log_entry_message) -> None:
    """Raise Ended for an empty log, and for one that the disk has no room for."""
    if not entry.size:
        raise Ended("failed", f"log {entry.id} of the vehicle is empty")
    if entry.size > MAX_BYTES:
        raise Ended("refused", f"log {entry.id} has {size(entry.size)}; {size(MAX_BYTES)} are downloaded at most")
    folder = flight.files.logs
    try:
        make_private_folder(folder)
        disk = os.statvfs(folder)
    except OSError as error:
        raise Ended("failed", f"{error.filename or folder}: {error.strerror}", "storage") from None
    free = disk.f_bavail * disk.f_frsize
    if free < entry.size + SPARE_BYTES:
        room = f"{size(free)} are free at {folder}, of which {size(SPARE_BYTES)} stay free"
        raise Ended("refused", f"log {entry.id} has {size(entry.size)}; {room}", "storage")


def _save(
    flight: ProcedureContext, run: ProcedureRun, entry: dialect.MAVLink_log_entry_message
) -> Generator[None, None, Path]:
    """Copy a log into a file that appears when it is complete. Returns its path. Raises OSError, Ended."""
    path = flight.files.logs / file_name(flight.files.robot, entry, flight.vehicle.autopilot, datetime.now(UTC))
    part = path.with_name(f".{path.name}.part")
    for left in path.parent.glob(f".{flight.files.robot}-log*.part"):  # of a bridge that was killed
        left.unlink()
    number = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    try:
        with FileIO(number, "w") as file:
            for start in range(0, entry.size, WINDOW):
                data = yield from _window(flight, run, entry, start)
                file.write(data)
            yield from _flush(run, file)
        part.replace(path)
    except BaseException:  # also when the action is cancelled
        with suppress(OSError):
            part.unlink()
        raise
    return path


def file_name(robot: str, entry: dialect.MAVLink_log_entry_message, autopilot: int | None, now: datetime) -> str:
    """Return a name for a log, of nothing that is text of the vehicle: `uav1-log00012-20261101T101500Z.bin`.

    Numbers begin again when logs are erased: the time is that of the log, or of its download where that is not known.
    """
    at = datetime.fromtimestamp(entry.time_utc, UTC) if entry.time_utc else now
    of = "" if entry.time_utc else "downloaded-"
    return f"{robot}-log{entry.id:05d}-{of}{at:%Y%m%dT%H%M%SZ}{SUFFIXES.get(autopilot or 0, '.log')}"


def _window(
    flight: ProcedureContext, run: ProcedureRun, entry: dialect.MAVLink_log_entry_message, start: int
) -> Generator[None, None, bytes]:
    """Return the bytes of a log from `start` to the end of the window; each gap is requested until it is filled."""
    length = min(WINDOW, entry.size - start)
    data, missing, tries = bytearray(length), set(range(0, length, PIECE)), 0
    while missing:
        first = min(missing)
        last = first
        while last + PIECE in missing:
            last += PIECE
        count = min(last + PIECE, length) - first
        flight.send(dialect.MAVLink_log_request_data_message(*flight.addressee, entry.id, start + first, count))
        before, until = len(missing), flight.now + flight.wait(*QUIET)
        while flight.now <= until and last in missing:
            received = start + length - min(length, len(missing) * PIECE)
            run.feedback = {"bytes": float(received), "of": float(entry.size)}
            run.waits_for = f"byte {start + first} of {entry.size} of log {entry.id}"
            yield from _look(flight)
            piece = flight.message
            if not isinstance(piece, dialect.MAVLink_log_data_message) or piece.id != entry.id:
                continue
            at = piece.ofs - start
            if at in missing and piece.count == min(PIECE, length - at):
                data[at : at + piece.count] = bytes(piece.data[: piece.count])
                missing.discard(at)
                until = flight.now + flight.wait(*QUIET)
        tries = 0 if len(missing) < before else tries + 1
        if tries >= TRIES:
            where = f"byte {start + min(missing)} of {entry.size}"
            raise Ended("failed", f"the vehicle sends no more of log {entry.id} at {where}, asked {TRIES} times")
    run.feedback = {"bytes": float(start + length), "of": float(entry.size)}
    return bytes(data)


def _flush(run: ProcedureRun, file: FileIO) -> Part:
    """Force a file to the disk on a thread: megabytes may take seconds, in which the vehicle must hear us.

    Raises OSError.
    """
    failure: list[OSError] = []

    def flush() -> None:
        try:
            os.fsync(file.fileno())
        except OSError as error:
            failure.append(error)

    thread = threading.Thread(target=flush, name="flushing a log", daemon=True)
    thread.start()
    while thread.is_alive():
        run.waits_for = "the disk"
        thread.join(FLUSH_STEP)
        yield
    if failure:
        raise failure[0]
