"""Payloads of the bus as JSON, as a recording holds them, and back."""

from __future__ import annotations

from base64 import b64encode

import msgspec

from argosy.recording.file.records import Unread, put_on, said_by
from schemas.wire.codec import MEDIA
from schemas.wire.records import Header

_JSON, _MSGPACK = msgspec.json.Encoder(), msgspec.msgpack.Encoder()
_ANY_MSGPACK = msgspec.msgpack.Decoder()
_OBJECT = msgspec.json.Decoder(dict[str, msgspec.Raw])


class Said(msgspec.Struct, frozen=True):
    """What a recorder reads of a record."""

    header: Header = Header()
    number: int = 0
    """Of a stretch of a mind's inputs."""
    final: bool = False
    """Whether that is the last one of its life."""


_SAID = msgspec.json.Decoder(Said)
NOTHING_SAID = Said()


def read(payload: bytes) -> Said | None:
    """Return what a JSON payload says of itself; None if it is no JSON object."""
    try:
        return _SAID.decode(payload)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        pass
    try:
        _OBJECT.decode(payload)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return None
    return NOTHING_SAID


def is_msgpack(encoding: str) -> bool:
    """Whether an Encoding says MessagePack."""
    return encoding.partition(";")[0] == MEDIA["msgpack"]


def to_json(payload: bytes) -> bytes | None:
    """Return a MessagePack payload as JSON; None if it is none, or JSON cannot say it."""
    try:
        return _JSON.encode(_ANY_MSGPACK.decode(payload))
    except (msgspec.MsgspecError, UnicodeError, RecursionError, TypeError, ValueError, OverflowError):
        return None


def said_in(payload: bytes, encoding: str) -> Said | None:
    """Return what a payload of the bus says of itself; None if it is no object."""
    data = to_json(payload) if is_msgpack(encoding) else payload
    return None if data is None else read(data)


def to_msgpack(data: bytes) -> bytes:
    """Return a JSON text as MessagePack: for a fleet that speaks that."""
    return _MSGPACK.encode(msgspec.json.decode(data))


def unread(payload: bytes, encoding: str, *, deleted: bool = False, key: str = "") -> bytes:
    """Return a payload that is no object, or was put on many keys at once, as a JSON object that holds it."""
    return _JSON.encode(Unread(key=key, encoding=encoding, base64=b64encode(payload).decode(), deleted=deleted))


def record_name(key: str, encoding: str) -> str:
    """Return the name of the record that a payload is: as its Encoding says, else as its key does."""
    return said_by(encoding) or ("" if encoding.partition(";")[2] else put_on(key))
