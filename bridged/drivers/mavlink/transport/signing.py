"""The last timestamps that were taken from other senders on one link, kept so that no packet is taken twice.

A stream is one link id, system and component under one key (MAVLink devguide, message_signing.md). The file holds for
each a bound at or above all that was taken: it is written ahead, so that a crash leaves nothing to be taken again. A
sender whose clock goes on is past the bound `AHEAD` later; one that is behind is sent the time, which is above it.
"""

from __future__ import annotations

import hashlib
import hmac
import logging
import os
import stat
import time
from collections.abc import Callable
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as dialect

from commd.process.state_dir import make_private_folder, replace_file

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
        """`file` outlives the process; without it only the streams since this start are remembered."""
        self.damage = ""
        """Why the kept streams were not read; empty if they were, or none was kept."""
        self.problem = ""
        """Why the file could not be written the last time."""
        self._file = file
        self._bounds: dict[bytes, int] = {}
        """The bound in the file."""
        self._last: dict[bytes, int] = {}
        """Timestamps taken since this start."""
        self._read()

    @property
    def latest(self) -> int:
        """The latest bound of all; a time that is sent to anybody must be later."""
        return max(self._bounds.values(), default=0)

    def objection(self, stream: bytes, timestamp: int, present: int) -> str:
        """Why a rightly signed packet is not taken, empty if it is: `replayed` or `outdated`.

        `timestamp` and `present` are in 10 µs since 2015. The first packet of a stream may be a minute behind
        `present`, and must be later than what was taken before a restart.
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
        try:
            replace_file(self._file, f"{text}\n{_digest(text)}\n".encode("ascii"), synced=False)
            self.problem = ""
        except OSError as error:
            self.problem = f"{self._file}: {reason_of(error)}"


def reason_of(error: OSError) -> str:
    """Return the reason of an error for people, without its number."""
    return (os.strerror(error.errno) if error.errno else str(error)).lower()


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode("ascii")).hexdigest()


BEGAN = 1_420_070_400
"""Unix seconds of 2015-01-01 00:00 UTC, from which timestamps count."""
FAR_AHEAD = 30 * 365 * 24 * 60 * MINUTE
"""No clock that a vehicle or a computer starts from is so far from ours; a timestamp that is would use up those that
are left until 2104, after which nothing can be signed."""
RESERVE = MINUTE
"""How far ahead timestamps are written down: the file is written once in this time, and a restarted bridge does not
begin below what it may have used before."""
SIGNATURE_BYTES = 13


class SigningError(ValueError):
    """A passphrase that cannot be used; the text says why, and does not show it."""


def read_key(path: Path) -> bytes:
    """The key made of the first line of a passphrase file. Raises SigningError.

    A file that others than its owner may read is refused: what it holds is no secret.
    """
    try:
        with path.open("rb") as file:
            mode = os.fstat(file.fileno()).st_mode
            passphrase = file.readline(4096).rstrip(b"\r\n")
    except OSError as error:
        raise SigningError(f"{path}: {reason_of(error)}") from None
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise SigningError(f"{path}: others than its owner may use this file: do `chmod 600 {path}`")
    if not passphrase:
        raise SigningError(f"{path}: expected the passphrase in the first line, it is empty")
    return key_of(passphrase)


def key_of(passphrase: bytes) -> bytes:
    """The 32 bytes that sign, as MAVProxy and Mission Planner make them."""
    return hashlib.sha256(passphrase).digest()


def now_10us() -> int:
    """The timestamp that the clock of this machine gives."""
    return max(1, int((time.time() - BEGAN) * PER_SECOND))


class Timestamps:
    """Our timestamps on one link: each one above all before, also after a restart and if the clock goes back."""

    def __init__(self, file: Path | None = None, clock: Callable[[], int] = now_10us) -> None:
        """`file` holds the bound below which any may have been used; without it they rise until the process ends.

        Raises OSError if the file cannot be read or written, SigningError if it holds something else.
        """
        self._file = file
        self._clock = clock
        self.problem = ""
        """Why the file could not be written the last time. A vehicle in flight is not abandoned for that."""
        self._last = self._reserved = self._read()
        if file is not None:
            make_private_folder(file.parent)
            self._write(self._reserved)

    @property
    def last_credible(self) -> int:
        """Later timestamps of others are not adopted."""
        return self._clock() + FAR_AHEAD

    @property
    def present(self) -> int:
        """The last one, or the time of the clock if it is later."""
        return max(self._last, self._clock())

    def next(self) -> int:
        """The next one to sign with, written down first."""
        following = max(self._last + 1, self._clock())
        if following >= self._reserved:
            self._reserve(following + RESERVE)
        self._last = following
        return following

    def heard(self, timestamp: int) -> None:
        """Continue from the `timestamp` (in 10 µs since 2015) of another holder of the key that is ahead (devguide).

        Clocks then need not agree.
        """
        self._last = max(self._last, timestamp)

    def close(self) -> None:
        """Give back what was reserved and not used."""
        if self._last < self._reserved:
            self._reserve(self._last + 1)

    def _read(self) -> int:
        if self._file is None or not self._file.exists():
            return 0
        content = self._file.read_text(encoding="ascii", errors="replace").strip()
        if not (content.isascii() and content.isdigit() and int(content) <= LATEST):
            raise SigningError(f"{self._file}: expected one number, the last timestamp, got {content[:40]!r}")
        return int(content)

    def _reserve(self, bound: int) -> None:
        try:
            self._write(bound)
            self.problem = ""
        except OSError as error:
            self.problem = f"{self._file}: {reason_of(error)}"
        self._reserved = bound

    def _write(self, bound: int) -> None:
        if self._file is not None:
            replace_file(self._file, f"{bound}\n".encode("ascii"))


class Signing:
    """Signing and checking by one holder of a key on one link."""

    def __init__(self, key: bytes, timestamps: Timestamps | None = None, streams: SignedStreams | None = None) -> None:
        """`streams` are those of all keys."""
        self._key = key
        self.timestamps = timestamps or Timestamps()
        self._streams = streams or SignedStreams()
        self._key_name = hashlib.sha256(b"argosy: name of a key" + key).digest()[:8]
        """Identifies a key in a file without revealing it."""
        if 0 < self._streams.latest <= self.timestamps.last_credible:
            self.timestamps.heard(self._streams.latest)

    def sign_with(self, protocol: dialect.MAVLink) -> None:
        """Let what `protocol` packs next be signed."""
        signing = protocol.signing
        signing.secret_key, signing.link_id, signing.sign_outgoing = self._key, 0, True
        signing.timestamp = self.timestamps.next()

    def objection(self, packet: bytes | bytearray) -> str:
        """Why a packet with a right checksum is not taken, empty if it is.

        It is `unsigned`, `wrongly signed`, `replayed`, `outdated` or `impossibly new`.
        """
        if packet[0] != dialect.PROTOCOL_MARKER_V2 or not packet[2] & dialect.MAVLINK_IFLAG_SIGNED:
            return "unsigned"
        ours = hashlib.sha256(self._key + packet[:-6]).digest()[:6]
        if not hmac.compare_digest(ours, packet[-6:]):
            return "wrongly signed"
        stream = self._key_name + bytes((packet[-SIGNATURE_BYTES], packet[5], packet[6]))
        timestamp = int.from_bytes(packet[-12:-6], "little")
        if timestamp > self.timestamps.last_credible:
            return "impossibly new"
        if objection := self._streams.objection(stream, timestamp, self.timestamps.present):
            return objection
        self.timestamps.heard(timestamp)
        return ""
