"""Ask a running bridge for what its vehicle stores, with progress; and write what came to a file, as a whole."""

from __future__ import annotations

from contextlib import aclosing
from pathlib import Path
from typing import TypeVar

from argosy.cli.errors import BadInput, CommandError, progress
from argosy.cli.operator_bus import Unanswered, replies
from commd.bus.bus import Bus
from commd.process.state_dir import write_output
from schemas.wire.vehicle_records import ParameterRequest, StoredPlan, VehicleParameters

AT_MOST = 360.0
"""Wall seconds of one request; the bridge ends it before."""
A = TypeVar("A", VehicleParameters, StoredPlan)


async def ask_vehicle(bus: Bus, key: str, ask: ParameterRequest | None, answer: type[A], robot: str, what: str) -> A:
    """Query a bridge and return its last reply; `what` names in the progress what arrives. Raises Unanswered."""
    problem = "its bridge does not answer: is it of an older version?"
    shown = False
    try:
        async with aclosing(replies(bus, key, ask, answer, AT_MOST)) as records:
            async for record in records:
                if isinstance(record, str):
                    problem = record
                    continue
                if record.done:
                    return record
                problem = "its bridge ended the request without a result"
                shown = progress(f"{robot}: {record.came} of {record.of or '?'} {what}")
    except TimeoutError as silent:
        problem = str(silent)
    finally:
        if shown:
            progress("")
    raise Unanswered(f"{robot}: {problem}")


def check_new(path: Path, force: bool) -> None:
    """Raise BadInput for a file that exists and is not to be overwritten."""
    if path.exists() and not force:
        raise BadInput(f"{path} exists: name another file, or overwrite it with --force")


def write_whole(path: Path, text: str) -> None:
    """Write a file as a whole or not at all. Raises CommandError."""
    try:
        write_output(path, text.encode())
    except OSError as error:
        raise CommandError(f"{path}: {error.strerror}") from None
