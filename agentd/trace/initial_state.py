"""What a mind is made of, told so that the same can be made again."""

from __future__ import annotations

import base64
import binascii
import re
import zlib
from dataclasses import dataclass
from datetime import UTC, timedelta, timezone, tzinfo
from typing import Final

import msgspec

from agentd.mind.persistence.rows import StoredMind
from agentd.trace.program_sources import Sources
from schemas.wire.mind_records import MindBirth

MOST_MEMORY: Final = 2_000_000
"""Bytes of what a former life has left, compressed; more of it does not fit into a record."""


@dataclass(slots=True)
class InitialState:
    """What one mind was made of."""

    sources: Sources | None
    seed: int
    start: float
    epoch: float
    zone: tzinfo
    names_variables: bool
    ask_timeout: float | None
    decisions: int
    kept: bool
    stored: StoredMind | None
    """What was restored."""
    unknown: str = ""
    """Why it cannot be made again, if that is so."""

    def record(self) -> MindBirth:
        """Return it as a record."""
        sources, unknown = self.sources or Sources(), self.unknown
        if self.sources is None:
            unknown = unknown or "the sources of its program were not kept"
        memory = "" if self.stored is None else pack(self.stored)
        if len(memory) > MOST_MEMORY:
            unknown = unknown or f"what it had kept of a former life is too large to record: {len(memory)} bytes"
            memory = ""
        return MindBirth(
            program=sources.main,
            files=sources.files,
            mission=sources.mission,
            beliefs=sources.beliefs,
            goals=sources.goals,
            on_restart=sources.on_restart,
            formulas=sources.formulas,
            decisions=self.decisions,
            kept=self.kept,
            seed=self.seed,
            start=self.start,
            epoch=self.epoch,
            zone=str(self.zone),
            names_variables=self.names_variables,
            ask_timeout=self.ask_timeout,
            memory=memory,
            unknown=unknown,
        )


_Rows = tuple[
    list[tuple[int, bytes]],
    list[tuple[int, bytes]],
    list[tuple[int, bytes]],
    list[tuple[tuple[int, int], int, bytes]],
    dict[str, bytes],
]
_ROWS: Final = msgspec.msgpack.Decoder(_Rows)


def pack(stored: StoredMind) -> str:
    """Return a stored mind as text."""
    rows = (stored.beliefs, stored.predicates, stored.plans, stored.pending, stored.values)
    return base64.b64encode(zlib.compress(msgspec.msgpack.encode(rows), 1)).decode()


def unpack(text: str) -> StoredMind:
    """Return the stored mind that a text stands for. Raises ValueError."""
    try:
        packed = zlib.decompress(base64.b64decode(text, validate=True))
        beliefs, predicates, plans, pending, values = _ROWS.decode(packed)
    except (zlib.error, binascii.Error, msgspec.MsgspecError) as error:
        raise ValueError(str(error)) from None
    return StoredMind(beliefs, predicates, plans, list(pending), values)


_OFFSET: Final = re.compile(r"UTC(?:([+-])(\d\d):(\d\d)(?::(\d\d))?)?\Z")


def zone_of(text: str) -> tzinfo:
    """Return the zone of a birth. Raises ValueError."""
    match = _OFFSET.match(text)
    if match is None:
        raise ValueError(f"`{text}` is no offset from UTC")
    sign, hours, minutes, seconds = match.groups()
    if sign is None:
        return UTC
    offset = timedelta(hours=int(hours), minutes=int(minutes), seconds=int(seconds or 0))
    return timezone(offset if sign == "+" else -offset)
