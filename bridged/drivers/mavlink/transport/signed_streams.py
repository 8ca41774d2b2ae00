"""The last timestamps that were taken from other senders on one link, kept so that no packet is taken twice.

A stream is one link id, system and component under one key (MAVLink devguide, message_signing.md). The file holds for
each a bound at or above all that was taken: it is written ahead, so that a crash leaves nothing to be taken again. A
sender whose clock goes on is past the bound `AHEAD` later; one that is behind is told the time, which is above it.
"""

from __future__ import annotations

import hashlib
import logging
import os
from pathlib import Path

from commd.process.state_dir import make_private_file

PER_SECOND = 100_000
"""Steps of a timestamp in a second."""
MINUTE = 60 * PER_SECOND
LATEST = 2**48 - 1
OUTDATED = "outdated"
"""The objection to a rightly signed packet of a sender whose clock is behind, or to a replay of an old one."""
AHEAD = 2 * PER_SECOND
"""How far bounds are written ahead: the file is written once in so long, and a sender is refused so long at most after
a crash. It is not forced to the disk: a cut of power may cost the last few seconds of it."""
MAX_STREAMS = 1024
"""Streams that are remembered; only holders of a key can make one."""
log = logging.getLogger("mavlink")


class SignedStreams:
    """The streams of one link, under all keys of its robots."""

    def __init__(self, file: Path | None = None) -> None:
        """`file` outlives the process; without it the streams of this life alone are remembered."""
        self.damage = ""
        """Why what earlier lives have kept was not read; empty if it was, or nothing was kept."""
        self.problem = ""
        """Why the file could not be written the last time."""
        self._file = file
        self._bounds: dict[bytes, int] = {}
        """What stands in the file."""
        self._last: dict[bytes, int] = {}
        """What was taken in this life."""
        self._read()

    @property
    def latest(self) -> int:
        """The latest bound of all: whoever is told the time must be told a later one."""
        return max(self._bounds.values(), default=0)

    def objection(self, stream: bytes, timestamp: int, present: int) -> str:
        """Why a rightly signed packet is not taken, empty if it is: `replayed` or `outdated`.

        The first packet of a stream may be a minute behind `present`, and must be later than what earlier lives took.
        """
        last = self._last.get(stream)
        if last is None and (timestamp <= self._bounds.get(stream, 0) or timestamp < present - MINUTE):
            return OUTDATED
        if last is not None and timestamp <= last:
            return "replayed"
        if last is None and len(self._last) >= MAX_STREAMS:
            oldest = next(iter(self._last))
            del self._last[oldest]
            self._bounds.pop(oldest, None)
        self._last[stream] = timestamp
        if timestamp > self._bounds.get(stream, 0):
            self._bounds |= {one: at + AHEAD for one, at in self._last.items()}
            self._write()
        return ""

    def close(self) -> None:
        """Give back what was written ahead."""
        if self._last:
            self._bounds |= self._last
            self._write()

    def _read(self) -> None:
        if self._file is None or not self._file.exists():
            return
        try:
            text, _, digest = self._file.read_text(encoding="ascii").rstrip("\n").rpartition("\n")
            if digest != _digest(text):
                raise ValueError("its checksum is wrong")
            for line in text.splitlines()[:MAX_STREAMS]:
                stream, timestamp = line.split()
                self._bounds[bytes.fromhex(stream)] = min(int(timestamp), LATEST)
        except (OSError, ValueError) as error:
            self._bounds.clear()
            why = "it is no text" if isinstance(error, UnicodeDecodeError) else str(error)
            self.damage = f"{self._file} is damaged ({why}): signed packets of the last minute may be taken again"
            log.error("%s", self.damage)

    def _write(self) -> None:
        if self._file is None:
            return
        text = "\n".join(f"{stream.hex()} {bound}" for stream, bound in self._bounds.items())
        fresh = self._file.with_name(self._file.name + ".new")
        try:
            make_private_file(fresh)
            fresh.write_text(f"{text}\n{_digest(text)}\n", encoding="ascii")
            fresh.replace(self._file)
            self.problem = ""
        except OSError as error:
            self.problem = f"{self._file}: {(os.strerror(error.errno) if error.errno else str(error)).lower()}"


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode("ascii")).hexdigest()
