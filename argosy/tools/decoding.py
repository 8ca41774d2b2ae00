"""Bytes on a key to the record that they are: by their Encoding if it is known, else by the key and what is in them."""

from __future__ import annotations

from functools import cache
from typing import Any

import msgspec

from schemas.manifest.loader import ActionDescription
from schemas.wire import keys, mind_records, records
from schemas.wire.codec import MEDIA, BadRecord, Wire, codec
from schemas.wire.records import Record

MSGPACK = frozenset((*range(0x80, 0x90), 0xDE, 0xDF))
"""With one of these bytes begins a MessagePack map, which every record is, and no JSON."""


def wire_of(payload: bytes, encoding: str = "") -> Wire:
    """Return how a payload is written."""
    if encoding.partition(";")[0] == MEDIA["msgpack"]:
        return "msgpack"
    return "msgpack" if payload[:1] and payload[0] in MSGPACK else "json"


def read_record(key: str, payload: bytes, encoding: str = "") -> Record | None:
    """Return the record, None if the payload is none of ours. Raises BadRecord for one that does not decode."""
    name, wire = _named(encoding), wire_of(payload, encoding)
    media = MEDIA[wire]
    if name:
        known = _by_name().get(name)
        return codec(known).decode(payload, encoding) if known is not None else None
    fields = _fields(payload, wire)
    if fields is None:
        return None
    fitting = [(_knows(kind, fields), kind) for kind in candidates(key) if _required(kind) <= fields]
    problem: BadRecord | None = None
    for knows_all, kind in fitting:
        if knows_all or len(fitting) == 1:  # of a newer sender none may know all
            try:
                return codec(kind).decode(payload, media)
            except BadRecord as bad:
                problem = problem or bad
    if problem is not None:
        raise problem
    return None


def plain(payload: bytes, encoding: str = "") -> Any:
    """Return what a payload says as Python values. Raises BadRecord if it is neither JSON nor MessagePack."""
    try:
        if wire_of(payload, encoding) == "msgpack":
            return msgspec.msgpack.decode(payload)
        return msgspec.json.decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise BadRecord(str(error)) from None


def candidates(key: str) -> tuple[type[Record], ...]:
    """Return the records that may be on a key, by the table of channels."""
    parsed = keys.parse(key.partition("?")[0])
    if parsed is None:
        return ()
    return _on("/".join(parsed[2][:1]), len(parsed[2]))


@cache
def _on(first: str, size: int) -> tuple[type[Record], ...]:
    found: dict[type[Record], None] = {}
    for channel in keys.CHANNELS:
        chunks = channel.key.split("/")[1:]
        if chunks[0] == first and (len(chunks) == size or chunks[-1] == "**"):
            for kind in (channel.answers, channel.carries):
                if kind is not None:
                    found[kind] = None
            if first == "action":
                found[ActionDescription] = None
    return tuple(found)


@cache
def _by_name() -> dict[str, type[Record]]:
    kinds = [value for module in (records, mind_records) for value in vars(module).values() if isinstance(value, type)]
    return {kind.__name__: kind for kind in (*kinds, ActionDescription) if issubclass(kind, Record)}


def _named(encoding: str) -> str:
    _, _, schema = encoding.partition(";")
    return schema.removeprefix("argosy.").partition("/")[0] if schema.startswith("argosy.") else ""


def _fields(payload: bytes, wire: Wire) -> set[str] | None:
    """Return the names of the fields of a payload, None if it is no map."""
    try:
        if wire == "msgpack":
            return set(msgspec.msgpack.decode(payload, type=dict[str, msgspec.Raw]))
        return set(msgspec.json.decode(payload, type=dict[str, msgspec.Raw]))
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return None


def _knows(kind: type[Record], fields: set[str]) -> bool:
    """Whether a record of this kind may have all these fields."""
    return fields <= {one.encode_name for one in msgspec.structs.fields(kind)}


@cache
def _required(kind: type[Record]) -> set[str]:
    """Return the fields without which there is no record of this kind."""
    return {one.encode_name for one in msgspec.structs.fields(kind) if one.required}
