"""Payloads of actions and samples: one codec per kind of payload, found by the sample's Encoding.

A further kind of payload, such as the CDR of ROS 2 over rmw_zenoh, is one more `Codec` in `CODECS`, and its encodings
in `BY_ENCODING`: nothing else in the driver knows what bytes look like. A codec that needs more than the bytes (CDR
does not say of which message type it is) is chosen per key in `codec_for`: that is where the manifest's entry comes in.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import msgspec

from bridged.drivers.api import Value
from bridged.drivers.argument_check import fields_of, filled
from schemas.manifest.loader import ActionEntry

DEFAULT = "json"
"""The kind of a payload if neither its Encoding nor the manifest names it."""
BARE = "data"
"""The field of a payload that is no object: a number, a text, a list."""
WHOLE = "."
"""The path of a field that is the whole payload: a bare number, text or list."""
_SILENT = frozenset(("", "zenoh/bytes", "zenoh/string", "text/plain", "application/octet-stream"))
"""Encodings of publishers that set none."""
_WORDS = 120
"""Characters of an error that are shown."""


class BadPayload(ValueError):
    """A payload that cannot be read, or a value that cannot be written."""


@dataclass(frozen=True)
class Codec:
    """One kind of payload."""

    encoding: str
    """Of our own samples."""
    write: Callable[[Any], bytes]
    """May raise any error."""
    read: Callable[[bytes], Any]
    """May raise any error."""

    def encode(self, value: object) -> bytes:
        """Return the payload. Raises BadPayload."""
        try:
            return self.write(value)
        except Exception as error:
            raise BadPayload(_words(error)) from None

    def decode(self, payload: bytes) -> Mapping[str, object]:
        """Return a payload's fields: an object's own, `data` of anything else, none of nothing. Raises BadPayload."""
        if not payload:
            return {}
        try:
            value = self.read(payload)
        except Exception as error:  # RecursionError too: whatever others put must not stop the bridge
            raise BadPayload(f"{_words(error)}: {payload[:40]!r}") from None
        return value if isinstance(value, dict) else {BARE: value}


CODECS = {
    "json": Codec("application/json", msgspec.json.Encoder().encode, msgspec.json.Decoder().decode),
    "msgpack": Codec("application/msgpack", msgspec.msgpack.Encoder().encode, msgspec.msgpack.Decoder().decode),
}
BY_ENCODING = {
    "application/json": "json",
    "text/json": "json",
    "application/msgpack": "msgpack",
    "application/x-msgpack": "msgpack",
    "application/vnd.msgpack": "msgpack",
}


def codec_for(encoding: str, default: str) -> Codec:
    """Return the codec of a sample: by its Encoding, or the `default` if that names none. Raises BadPayload."""
    kind, _, _ = encoding.partition(";")
    name = default if kind in _SILENT else BY_ENCODING.get(kind)
    if name is None:
        raise BadPayload(
            f"encoding `{encoding[:_WORDS]}`, expected {' or '.join(one.encoding for one in CODECS.values())}"
        )
    return CODECS[name]


def _words(error: Exception) -> str:
    return (str(error) or type(error).__name__)[:_WORDS]


def payload_of(entry: ActionEntry, arguments: Mapping[str, Value]) -> object:
    """Return the payload of an action as an object or list, nested as the paths say. Raises ValueError."""
    tree: dict[str, Any] = {}
    for path, declared in fields_of(entry).items():
        value: object = filled(f"field `{path}`", declared, arguments)
        if path == WHOLE:
            return value
        *way, last = path.split(".")
        at = tree
        for step in way:
            at = at.setdefault(step, {})
        at[last] = value
    return _lists(tree)


def _lists(value: Any) -> Any:
    """Make lists of the objects whose fields are 0, 1, ..."""
    if not isinstance(value, dict):
        return value
    if value and all(step.isdecimal() for step in value):
        return [_lists(value[str(index)]) for index in range(len(value))]
    return {step: _lists(inner) for step, inner in value.items()}
