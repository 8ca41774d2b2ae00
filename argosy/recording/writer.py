"""Write MCAP files that survive a killed recorder.

Each second ends a chunk, which is handed to the operating system: a kill loses one second at most. Every `SYNC` seconds
the file is synced to the disk, for a loss of power.
"""

from __future__ import annotations

import errno
import fcntl
import os
import stat
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Literal

from mcap.writer import CompressionType, Writer
from msgspec.structs import replace

from argosy.recording.json_schema import json_schema
from argosy.recording.metadata import BEGIN, END, End, Facts
from argosy.recording.records import (
    NO_HEAD,
    PREFIX,
    RECORDS,
    RecordHead,
    Unread,
    head_of,
    is_msgpack,
    record_name,
    to_json,
    unread_payload,
)
from argosy.recording.write_queue import Heard
from schemas.version import RELEASE

Compression = Literal["none", "lz4", "zstd"]
COMPRESSIONS: dict[Compression, CompressionType] = {
    "none": CompressionType.NONE,
    "lz4": CompressionType.LZ4,
    "zstd": CompressionType.ZSTD,
}
SYNC = 10.0
"""Wall seconds between two syncs to the disk."""
CHUNK = 1024 * 1024
"""Bytes after which a chunk ends before its second is over."""
MOST_CHANNELS = 60_000
"""Keys of one file; messages on further ones are dropped and counted. MCAP counts channels in 16 bits."""
NO_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS)
"""Errors of file systems without locks."""
FOREIGN = "json"
"""Schema name of objects that are not records of Argosy."""
_ANY_OBJECT = b'{"type": "object", "properties": {}}'


@dataclass(slots=True)
class _Channel:
    id: int
    reads: Literal["json", "msgpack", "unread"]


class RecordingWriter:
    """One file of a recording."""

    def __init__(self, path: Path, facts: Facts, compression: Compression = "lz4", *, overwrite: bool = False) -> None:
        """Create the file. Raises FileExistsError, or OSError if it cannot be created or another recorder writes it."""
        self.path = path
        self._file = _opened(path, overwrite=overwrite)
        self._writer = Writer(self._file, CHUNK, COMPRESSIONS[compression])
        self._channels: dict[tuple[str, str, str], _Channel | None] = {}
        self._unread_channels: dict[tuple[str, str], _Channel | None] = {}
        self._schemas: dict[str, int] = {}
        self._count = self._size = 0
        self.messages = self.unread = self.no_channel = 0
        """Messages written; of these as bytes; and messages left out because there are too many keys."""
        self.safe = 0
        """Messages handed to the operating system: they survive a kill."""
        self._synced = time.monotonic()
        self._writer.start(library=f"argosy {RELEASE}")
        self._writer.add_metadata(BEGIN, facts.metadata())
        self.flush()
        os.fsync(self._file.fileno())

    @property
    def channels(self) -> int:
        """Number of keys."""
        return self._count

    @property
    def size(self) -> int:
        """Bytes written so far, without the open chunk."""
        return self._file.tell() if not self._file.closed else self._size

    def add(self, heard: Heard) -> RecordHead | None:
        """Write a message. Returns its head; None if it was left out."""
        key = (heard.key, heard.encoding, heard.origin)
        channel = self._channels.get(key)
        if channel is None and (key in self._channels or (channel := self._open(heard)) is None):
            self.no_channel += 1
            return None
        data: bytes | None = heard.payload
        if channel.reads == "msgpack":
            data = to_json(heard.payload)
        head = None if data is None or heard.deleted else head_of(data)
        if head is None or data is None:
            return self._add_unread(heard)
        self._write(channel.id, heard.at, data, head)
        return head

    def _write(self, channel: int, at: int, data: bytes, head: RecordHead) -> None:
        stamp, seq = head.header.stamp, head.header.seq
        publish_time = stamp if 0 < stamp < 1 << 64 else at
        self._writer.add_message(channel, at, data, publish_time, seq & 0xFFFFFFFF)
        self.messages += 1

    def _add_unread(self, heard: Heard) -> RecordHead | None:
        key = (heard.key, heard.encoding)
        if key not in self._unread_channels:
            self._unread_channels[key] = self._register(heard.key, Unread.__name__, heard, "unread")
        channel = self._unread_channels[key]
        if channel is None:
            self.no_channel += 1
            return None
        data = unread_payload(heard.payload, heard.encoding, deleted=heard.deleted)
        self._write(channel.id, heard.at, data, NO_HEAD)
        self.unread += not heard.deleted
        return NO_HEAD

    def _open(self, heard: Heard) -> _Channel | None:
        name = record_name(heard.key, heard.encoding)
        reads: Literal["json", "msgpack"] = "msgpack" if is_msgpack(heard.encoding) else "json"
        made = self._register(heard.key, name, heard, reads)
        if len(self._channels) < 2 * MOST_CHANNELS:
            self._channels[heard.key, heard.encoding, heard.origin] = made
        return made

    def _register(
        self, topic: str, name: str, heard: Heard, reads: Literal["json", "msgpack", "unread"]
    ) -> _Channel | None:
        if self._count >= MOST_CHANNELS:
            return None
        self._count += 1
        metadata = {"encoding": heard.encoding, "origin": heard.origin}
        return _Channel(self._writer.register_channel(topic, "json", self._schema(name), metadata), reads)

    def _schema(self, name: str) -> int:
        if name not in self._schemas:
            record = RECORDS.get(name)
            called = PREFIX + name if record is not None else FOREIGN
            text = json_schema(record) if record is not None else _ANY_OBJECT
            self._schemas[name] = self._writer.register_schema(called, "jsonschema", text)
        return self._schemas[name]

    def flush(self) -> None:
        """End the chunk and hand it to the operating system, every `SYNC` seconds to the disk. Raises OSError."""
        self._writer.flush()
        self.safe = self.messages
        if time.monotonic() - self._synced >= SYNC:
            os.fsync(self._file.fileno())
            self._synced = time.monotonic()

    def close(self, end: End) -> None:
        """Write the end record and the index. Raises OSError."""
        try:
            self._writer.flush()
            self.safe = self.messages
            self._writer.add_metadata(END, replace(end, messages=self.messages, unread=self.unread).metadata())
            self._writer.finish()
            self._file.flush()
            os.fsync(self._file.fileno())
            self._size = self._file.tell()
        finally:
            self._file.close()

    def abandon(self) -> None:
        """Close the file after a failure: it is readable up to the last chunk."""
        with suppress(OSError):  # what could not be written before cannot be now
            self._file.close()
        with suppress(OSError):
            self._size = self.path.stat().st_size


def _opened(path: Path, *, overwrite: bool) -> BinaryIO:
    """Return an empty file, locked by this recorder. Raises OSError."""
    number = os.open(path, os.O_RDWR | os.O_CREAT | (0 if overwrite else os.O_EXCL), 0o600)
    try:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise BlockingIOError(errno.EWOULDBLOCK, "another recorder is writing it", str(path)) from None
        except OSError as error:
            if error.errno not in NO_LOCKS:
                raise
        if stat.S_ISREG(os.fstat(number).st_mode):
            os.ftruncate(number, 0)
        return os.fdopen(number, "wb")
    except OSError:
        os.close(number)
        raise
