"""The records of an MCAP file one after the other, also of one that was cut off in the middle.

A recorder that was killed leaves a file without its end. All that stands before the cut is whole: each record tells its
length first. `mcap.stream_reader` is not used: it passes over zeros, unpacks lz4 to any size, and takes 1.8 times as
long.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Metadata, Schema

from schemas.files.text_files import open_regular

MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")
CUT = "it was cut off, or is still being written"
LARGEST = 1 << 26
"""Bytes of the largest record that is read, packed or not: a longer one is damage. A recorder's are much smaller."""
_READ: dict[int, Any] = {
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.CHUNK: Chunk.read,
    Opcode.METADATA: Metadata.read,
}


class BadRecording(ValueError):
    """A file that is no recording of ours; says in one line which and why."""


@dataclass(frozen=True)
class Damage:
    """Where a file ends to make sense."""

    at: int
    """Byte up to which it was read."""
    left: int
    """Bytes behind it that could not be read."""
    why: str


class McapFile:
    """Reads the records of one file in their order; `damage` is known once they are read."""

    def __init__(self, path: Path) -> None:
        """Raises BadRecording for a file that is none of MCAP's, or cannot be read."""
        self.path = path
        self.damage: Damage | None = None
        try:
            with open_regular(path) as file:
                begin = file.read(len(MAGIC))
        except OSError as error:
            raise BadRecording(f"{path}: {error.strerror}") from None
        if begin != MAGIC:
            what = "it is empty" if not begin else "it does not begin as one"
            raise BadRecording(f"{path}: no MCAP file: {what}")

    def records(self) -> Iterator[Schema | Channel | Message | Metadata]:
        """Yield schemas, channels, messages and metadata up to the end, or to the damage."""
        self.damage = None
        size = self.path.stat().st_size
        with open_regular(self.path) as file:
            file.seek(at := len(MAGIC))
            while True:
                if at + _HEAD.size > size:
                    self.damage = Damage(at, size - at, CUT)
                    return
                opcode, length = _HEAD.unpack(file.read(_HEAD.size))
                end = at + _HEAD.size + length
                if end > size:
                    self.damage = Damage(at, size - at, CUT)
                    return
                if opcode == Opcode.DATA_END:
                    self._look_at_the_end(file, size, at)
                    return
                try:
                    yield from _decoded(opcode, length, file)
                except _DAMAGE as error:
                    self.damage = Damage(at, size - at, f"it is damaged ({error or type(error).__name__})")
                    return
                file.seek(at := end)

    def _look_at_the_end(self, file: BinaryIO, size: int, at: int) -> None:
        file.seek(size - len(MAGIC))
        if file.read(len(MAGIC)) != MAGIC:
            self.damage = Damage(at, 0, "its index was cut off")


_DAMAGE = (McapError, struct.error, ValueError, KeyError, EOFError, RuntimeError, OSError, MemoryError, OverflowError)


def _decoded(opcode: int, length: int, file: BinaryIO) -> Iterator[Schema | Channel | Message | Metadata]:
    if length > LARGEST:
        raise ValueError(f"a record of {length} bytes")
    if not opcode:  # there is no such record: zeros are what a loss of power leaves
        raise ValueError("there are zeros in it")
    if opcode == Opcode.MESSAGE:
        yield Message.read(ReadDataStream(BytesIO(file.read(length))), length)
        return
    if (read := _READ.get(opcode)) is None:
        return
    record = read(ReadDataStream(BytesIO(file.read(length))))
    if isinstance(record, Chunk):
        yield from _of_chunk(record)
    else:
        yield record


def _of_chunk(chunk: Chunk) -> Iterator[Schema | Channel | Message]:
    data = _unpacked(chunk)
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("a chunk has another checksum")
    at, size = 0, len(data)
    while at < size:
        opcode, length = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        if not opcode or at + length > size:
            raise ValueError("a chunk holds what is no record")
        part = data[at : at + length]
        at += length
        if opcode == Opcode.MESSAGE:
            channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(part)
            yield Message(
                channel_id=channel,
                sequence=sequence,
                log_time=log_time,
                publish_time=publish_time,
                data=part[_MESSAGE.size :],
            )
        elif opcode in (Opcode.CHANNEL, Opcode.SCHEMA):
            yield _READ[opcode](ReadDataStream(BytesIO(part)))


def _unpacked(chunk: Chunk) -> bytes:
    """Return what a chunk holds: as much as it says, which is to be no more than is ever written. Raises ValueError."""
    size: int = chunk.uncompressed_size
    data: bytes
    if size > LARGEST:
        raise ValueError(f"a chunk of {size} bytes")
    try:
        match chunk.compression:
            case "":
                data = chunk.data
            case "lz4":
                data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
            case "zstd":
                stream = zstandard.ZstdDecompressor(max_window_size=LARGEST).stream_reader(chunk.data)
                data = stream.read(size + 1)
            case other:
                raise ValueError(f"no compression is called {other}")
    except Exception as error:  # each compression has errors of its own
        raise ValueError(f"a chunk cannot be unpacked: {error}") from None
    if len(data) != size:
        raise ValueError("a chunk is of another size than it says")
    return data


_MESSAGE = struct.Struct("<HIQQ")
