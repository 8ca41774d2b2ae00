"""Encode and decode records as JSON or MessagePack; the Encoding names both: `application/json;argosy.Perception/1`."""

from __future__ import annotations

from typing import Any, ClassVar, Generic, Literal, TypeVar

import msgspec

from schemas.files.validation import FIRST_USE
from schemas.wire.records import VERSION, Record
from schemas.wire.terms import decode_hook

Wire = Literal["json", "msgpack"]
R = TypeVar("R", bound=Record)

MEDIA: dict[Wire, str] = {"json": "application/json", "msgpack": "application/msgpack"}
MAX_BYTES = 4 * 1024 * 1024
"""Bytes; a larger payload is refused unread."""


class BadRecord(ValueError):
    """Bytes that are not the expected record; the text says where and what was expected."""

    code: ClassVar[str] = "bad_record"
    """For programs; the error reply to a query with such a payload has it."""


class TooDeep(BadRecord):
    """A record that is nested too deeply to decode."""

    code = "too_deep"


class OtherVersion(BadRecord):
    """A record of another major version."""

    code = "other_version"

    def __init__(self, record: str, version: str) -> None:
        super().__init__(f"{record}: version {version or '?'} of the record, this daemon speaks version {VERSION}")
        self.version = version
        """The version in the Encoding."""


class Codec(Generic[R]):
    """Encodes and decodes one type of record; made once per type."""

    def __init__(self, record: type[R]) -> None:
        self.record = record
        self._json = msgspec.json.Decoder(record, dec_hook=decode_hook)
        self._msgpack = msgspec.msgpack.Decoder(record, dec_hook=decode_hook)
        self.encodings = {wire: f"{media};argosy.{record.__name__}/{VERSION}" for wire, media in MEDIA.items()}
        """The Encoding of this record on each wire."""
        self._wires = {encoding: wire for wire, encoding in self.encodings.items()}
        self._known = frozenset(field.encode_name for field in msgspec.structs.fields(record))
        self._probe = msgspec.json.Decoder(dict[str, msgspec.Raw])
        self._probe_msgpack = msgspec.msgpack.Decoder(dict[str, msgspec.Raw])

    def encode(self, record: R, wire: Wire = "json") -> bytes:
        """Return the bytes of `record`. Raises BadRecord if it is nested too deeply, has too large numbers, or is no
        Unicode."""
        try:
            return _JSON.encode(record) if wire == "json" else _MSGPACK.encode(record)
        except RecursionError:
            raise TooDeep(f"{self.record.__name__}: nested too deeply to send") from None
        except UnicodeEncodeError as error:
            half = ascii(error.object[error.start])
            raise BadRecord(f"{self.record.__name__}: expected Unicode text, got half a character: {half}") from None
        except (OverflowError, TypeError) as error:
            raise BadRecord(f"{self.record.__name__}: {error}") from None

    def decode(self, payload: bytes, encoding: str = "") -> R:
        """Return the record in `payload`; without an encoding it is JSON, as sent by hand.

        Raises BadRecord that names the field and what was expected, or the other version.
        """
        name = self.record.__name__
        if len(payload) > MAX_BYTES:
            raise BadRecord(f"{name}: {len(payload)} bytes, expected at most {MAX_BYTES}")
        try:
            if (self._wires.get(encoding) or self._wire(encoding)) == "json":
                return self._json.decode(payload)
            return self._msgpack.decode(payload)
        except msgspec.MsgspecError as error:
            raise BadRecord(f"{name}: {error}") from None
        except RecursionError:
            raise TooDeep(f"{name}: nested too deeply") from None
        except UnicodeDecodeError:
            raise BadRecord(f"{name}: a string is not valid UTF-8") from None

    def unknown_fields(self, payload: bytes, encoding: str = "") -> list[str]:
        """Return the top-level fields of a decodable payload that this version does not know."""
        json = (self._wires.get(encoding) or self._wire(encoding)) == "json"
        probe = self._probe if json else self._probe_msgpack
        try:
            return sorted(set(probe.decode(payload)) - self._known)
        except (UnicodeDecodeError, msgspec.MsgspecError):  # in a field name, which decoding ignored
            return ["\ufffd"]

    def _wire(self, encoding: str) -> Wire:
        """Return the wire of an encoding that is not one of ours. Raises BadRecord if it names another record."""
        name = self.record.__name__
        recorded, version = named_by(encoding)
        if recorded:
            if version != str(VERSION):  # before the name: another version may reply with another record
                raise OtherVersion(name, version)
            if recorded != name:
                raise BadRecord(f"{name}: expected a {name}, got a {recorded}")
        return "msgpack" if encoding.partition(";")[0] == MEDIA["msgpack"] else "json"


def named_by(encoding: str) -> tuple[str, str]:
    """Return the record that an Encoding names, and its version; both empty = none of ours."""
    schema = encoding.partition(";")[2]
    record, _, version = schema.removeprefix("argosy.").partition("/") if schema.startswith("argosy.") else ("", "", "")
    return record, version


_JSON = msgspec.json.Encoder()
_MSGPACK = msgspec.msgpack.Encoder()
_CODECS: dict[type[Record], Codec[Any]] = {}


def codec(record: type[R]) -> Codec[R]:
    """Return the codec of a record type."""
    found = _CODECS.get(record)
    if found is None:
        with FIRST_USE:
            found = _CODECS[record] = Codec(record)
    return found
