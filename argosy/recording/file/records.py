"""What stands in a recording besides the records of the bus, and which record travels on a key."""

from __future__ import annotations

import re
from functools import cache

from schemas.wire import keys
from schemas.wire.records import Record

PREFIX = "argosy."
"""Stands before the name of a record, in Encodings and as name of the schema in a file."""


class TokenSeen(Record, frozen=True, kw_only=True):
    """A daemon came or went: its liveliness token."""

    key: str
    """`argosy/{fleet}/{name}/alive/{daemon}/{boot}`."""
    alive: bool


class Unread(Record, frozen=True, kw_only=True):
    """What was put and is neither JSON nor MessagePack of an object, or was put on many keys at once."""

    key: str = ""
    """The key expression, if it was put on many keys at once; empty: on the key under which it stands here."""
    encoding: str = ""
    base64: str = ""
    deleted: bool = False
    """The key was deleted: there was no payload."""


class RecorderNote(Record, frozen=True, kw_only=True):
    """Something that happened to the recorder itself: what is missing, and why."""

    kind: str
    """`dropped`, `gap`, `router`."""
    text: str


OWN: tuple[type[Record], ...] = (TokenSeen, Unread, RecorderNote)
RECORDS: dict[str, type[Record]] = {
    record.__name__: record
    for record in (*(r for c in keys.CHANNELS for r in (c.carries, c.answers)), *OWN)
    if record is not None
}
"""By name, all that a recording may hold."""


def said_by(encoding: str) -> str:
    """Return the name of the record that an Encoding names; empty = it names none of ours."""
    _, _, schema = encoding.partition(";")
    name = schema.removeprefix(PREFIX).partition("/")[0] if schema.startswith(PREFIX) else ""
    return name if name in RECORDS else ""


@cache
def _patterns() -> tuple[tuple[re.Pattern[str], str], ...]:
    def pattern(key: str) -> re.Pattern[str]:
        chunks = ("[^/]+" if chunk.startswith("{") else re.escape(chunk) for chunk in key.split("/"))
        return re.compile(f"{keys.ROOT}/[^/]+/{'/'.join(chunks)}")

    return tuple(
        (pattern(channel.key), channel.carries.__name__)
        for channel in keys.CHANNELS
        if channel.kind == "put" and channel.carries is not None
    )


def put_on(key: str) -> str:
    """Return the name of the record that is put on a key, by the table of channels; empty = none is."""
    return next((name for pattern, name in _patterns() if pattern.fullmatch(key)), "")
