"""Read the records of an MCAP file in order, also of a truncated one.

A killed recorder leaves a file without its end. Everything before the cut is complete, as each record begins with its
length. `mcap.stream_reader` is not used: it skips zeros, unpacks lz4 to any size, and takes 1.8 times as long.
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

from argosy.cli.errors import BadInput
from schemas.files.text_files import near_file, open_regular, other_kind

MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")
CUT = "it was cut off, or is still being written"
LARGEST = 1 << 26
"""Largest accepted record in bytes, packed or not: a longer one is damage. A recorder's are much smaller."""
_READ: dict[int, Any] = {
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.CHUNK: Chunk.read,
    Opcode.METADATA: Metadata.read,
}


class BadRecording(BadInput):
    """A file is not a recording of ours; the text says which and why, in one line."""


@dataclass(frozen=True)
class Damage:
    """Where a file becomes unreadable."""

    at: int
    """Bytes that were read."""
    left: int
    """Bytes after them that cannot be read."""
    why: str


class McapFile:
    """Reads the records of one file in order; `damage` is known once they are read."""

    def __init__(self, path: Path) -> None:
        """Raises BadRecording if it cannot be read or is not an MCAP file."""
        self.path = path
        self.damage: Damage | None = None
        try:
            with open_regular(path) as file:
                begin = file.read(len(MAGIC))
        except OSError as error:
            raise BadRecording(f"{path}: {error.strerror}{near_file(path)}") from None
        if begin != MAGIC:
            what = "it is empty" if not begin else other_kind(path, ".mcap") or "it does not begin like one"
            raise BadRecording(f"{path}: not an MCAP file: {what}")

    def records(self) -> Iterator[Schema | Channel | Message | Metadata]:
        """Yield schemas, channels, messages and metadata up to the end, or up to the damage."""
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
                    file.seek(size - len(MAGIC))
                    if file.read(len(MAGIC)) != MAGIC:
                        self.damage = Damage(at, 0, "its index was cut off")
                    return
                try:
                    yield from _decoded(opcode, length, file)
                except _DAMAGE as error:
                    self.damage = Damage(at, size - at, f"it is damaged ({error or type(error).__name__})")
                    return
                file.seek(at := end)


_DAMAGE = (McapError, struct.error, ValueError, KeyError, EOFError, RuntimeError, OSError, MemoryError, OverflowError)


def _decoded(opcode: int, length: int, file: BinaryIO) -> Iterator[Schema | Channel | Message | Metadata]:
    if length > LARGEST:
        raise ValueError(f"a record of {length} bytes")
    if not opcode:  # no such record exists: a loss of power leaves zeros
        raise ValueError("it contains zeros")
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
        raise ValueError("a chunk has a wrong checksum")
    at, size = 0, len(data)
    while at < size:
        opcode, length = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        if not opcode or at + length > size:
            raise ValueError("a chunk contains an invalid record")
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
    """Return the content of a chunk, `LARGEST` bytes at most. Raises ValueError if its size is not as declared."""
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
                raise ValueError(f"unknown compression {other}")
    except Exception as error:  # each compression has errors of its own
        raise ValueError(f"a chunk cannot be unpacked: {error}") from None
    if len(data) != size:
        raise ValueError("a chunk does not have its declared size")
    return data


_MESSAGE = struct.Struct("<HIQQ")
