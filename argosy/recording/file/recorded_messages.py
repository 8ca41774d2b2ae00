"""A message of a recording, as its reader hands it out."""

from __future__ import annotations

from dataclasses import dataclass

from argosy.recording.file.records import RECORDS
from schemas.wire.codec import BadRecord, codec
from schemas.wire.records import Record


@dataclass(frozen=True, slots=True)
class Track:
    """A channel of a file: a key, and what is said there."""

    key: str
    name: str
    """Of the record, such as `Perception`; empty = JSON of others."""
    encoding: str
    """As it was on the bus; the recording itself holds JSON."""
    origin: str
    """`put`, `query` (an answer, so it was there before), `token` or `recorder`."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """A message of a recording."""

    track: Track
    at: int
    """Unix nanoseconds at which the recorder took it."""
    stamp: int
    """Unix nanoseconds that its header has; that of `at` if it has none."""
    seconds: float
    """Since the beginning of the recording."""
    data: bytes
    """JSON."""

    @property
    def key(self) -> str:
        """The key on which it was said."""
        return self.track.key

    @property
    def name(self) -> str:
        """Name of its record; empty = none of ours."""
        return self.track.name

    @property
    def origin(self) -> str:
        """`put`, `query`, `token` or `recorder`."""
        return self.track.origin

    @property
    def record(self) -> Record | None:
        """The record, decoded anew each time; None for what is none of ours, or does not decode."""
        kind = RECORDS.get(self.name)
        if kind is None:
            return None
        try:
            return codec(kind).decode(self.data)
        except BadRecord:
            return None


@dataclass(frozen=True)
class Topic:
    """What was said on a key, all together."""

    key: str
    record: str
    messages: int
