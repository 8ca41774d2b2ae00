"""The records in a recording, and their JSON: which record travels on a key, and payloads of the bus as JSON and back.

A recording may hold anything that was ever put on the wire. Only keys that are plain, each of one fleet, are published
again: a key with `*` reaches many fleets, and a key outside `argosy/` may drive somebody's robot.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable

import msgspec
import zenoh

from schemas.files.findings import Findings
from schemas.wire import keys
from schemas.wire.codec import MEDIA, named_by
from schemas.wire.records import Header, Record

PREFIX = "argosy."
"""Precedes the name of a record in Encodings and in the schema names of a file."""
_EXPRESSIONS = frozenset("*$?#")
"""Characters of key expressions and selectors, which no plain key has."""
_JSON, _MSGPACK = msgspec.json.Encoder(), msgspec.msgpack.Encoder()
_ANY_MSGPACK = msgspec.msgpack.Decoder()
_OBJECT = msgspec.json.Decoder(dict[str, msgspec.Raw])


class TokenSeen(Record, frozen=True, kw_only=True):
    """The liveliness token of a daemon appeared or disappeared."""

    key: str
    """`argosy/{fleet}/{name}/alive/{daemon}/{boot}`."""
    alive: bool


class Unread(Record, frozen=True, kw_only=True):
    """A payload that is neither a JSON nor a MessagePack object, or that was put on several keys by one expression."""

    key: str = ""
    """The key expression, if it was put on several keys; empty = the topic is the key."""
    encoding: str = ""
    base64: str = ""
    deleted: bool = False
    """The key was deleted: there was no payload."""


class RecorderNote(Record, frozen=True, kw_only=True):
    """An event of the recorder itself: what is missing, and why."""

    kind: str
    """`dropped`, `gap`, `router`."""
    text: str


RECORDS = keys.RECORDS | {record.__name__: record for record in (TokenSeen, Unread, RecorderNote)}
"""All records that a recording may hold, by name."""


class RecordHead(msgspec.Struct, frozen=True):
    """The fields of a record that the recorder reads."""

    header: Header = Header()
    number: int = 0
    """Of a batch of a mind's inputs."""
    final: bool = False
    """Whether that batch is the last one of its agent."""


_HEAD = msgspec.json.Decoder(RecordHead)
NO_HEAD = RecordHead()


def record_of_encoding(encoding: str) -> str:
    """Return the name of the record that an Encoding names; empty = none of ours."""
    name, _ = named_by(encoding)
    return name if name in RECORDS else ""


def record_put_on(key: str) -> str:
    """Return the name of the record that is put on a key, by the table of channels; empty = none is."""
    put = (channel.carries for channel in keys.channels_of(key) if channel.kind == "put")
    return next((record.__name__ for record in put if record is not None), "")


def record_name(key: str, encoding: str) -> str:
    """Return the record that a payload holds: by its Encoding, or by its key if the Encoding names no schema."""
    return record_of_encoding(encoding) or ("" if encoding.partition(";")[2] else record_put_on(key))


def is_plain(key: str) -> bool:
    """Whether a key names one thing: no chunk of it is empty or an expression."""
    return _EXPRESSIONS.isdisjoint(key) and all(key.split("/"))


def fleet_of(key: str) -> str | None:
    """Return the fleet of a plain key below `argosy/`; None for every other key, and for what is no fleet's name."""
    parsed = keys.parse(key) if is_plain(key) else None
    return parsed[0] if parsed is not None and keys.is_name(parsed[0]) else None


def wanted_keys(fleet: str, only: Iterable[str]) -> list[str]:
    """Return key expressions as they are on the bus: those that do not begin with `argosy/` are of the fleet.

    Raises Findings for an invalid key expression.
    """
    found = []
    for text in only:
        key = text if text == keys.ROOT or text.startswith(f"{keys.ROOT}/") else f"{keys.ROOT}/{fleet}/{text}"
        try:
            found.append(str(zenoh.KeyExpr.autocanonize(key)))
        except zenoh.ZError:
            expected = "expected a key expression such as `uav1/**` or `*/percept/**`"
            raise Findings.about("--only", f"`{text}`: {expected}") from None
    return found


def head_of(data: bytes) -> RecordHead | None:
    """Return the head of a JSON record; None if it is no JSON object."""
    try:
        return _HEAD.decode(data)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        pass
    try:
        _OBJECT.decode(data)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return None
    return NO_HEAD


def head_of_payload(payload: bytes, encoding: str) -> RecordHead | None:
    """Return the head of a payload of the bus; None if it is no object."""
    data = to_json(payload) if is_msgpack(encoding) else payload
    return None if data is None else head_of(data)


def is_msgpack(encoding: str) -> bool:
    """Whether an Encoding names MessagePack."""
    return encoding.partition(";")[0] == MEDIA["msgpack"]


def to_json(payload: bytes) -> bytes | None:
    """Return a MessagePack payload as JSON; None if it is invalid, or holds what JSON cannot express."""
    try:
        return _JSON.encode(_ANY_MSGPACK.decode(payload))
    except (msgspec.MsgspecError, UnicodeError, RecursionError, TypeError, ValueError, OverflowError):
        return None


def to_msgpack(data: bytes) -> bytes:
    """Return JSON as MessagePack."""
    return _MSGPACK.encode(msgspec.json.decode(data))


def unread_payload(payload: bytes, encoding: str, *, deleted: bool = False, key: str = "") -> bytes:
    """Return an `Unread` record, as JSON, that holds a payload."""
    return _JSON.encode(Unread(key=key, encoding=encoding, base64=b64encode(payload).decode(), deleted=deleted))
