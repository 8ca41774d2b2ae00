"""The recorder: a thread that filters and writes what was received, once a second, until it is stopped or full."""

from __future__ import annotations

import errno
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Thread
from typing import Final

import msgspec
from msgspec.structs import replace

from argosy.recording.metadata import SECOND, End, Facts
from argosy.recording.mind_inputs import PART, Minds, Whose
from argosy.recording.records import (
    RecorderNote,
    TokenSeen,
    Unread,
    head_of_payload,
    is_plain,
    unread_payload,
)
from argosy.recording.write_queue import Heard, WriteQueue
from argosy.recording.writer import Compression, RecordingWriter
from schemas.files.units import Duration
from schemas.humanize import size
from schemas.wire import keys
from schemas.wire.codec import codec

NOTES: Final = "argosy/recorder"
"""Topic of the recorder's own notes."""
PERIOD: Final = 1.0
"""Wall seconds between two chunks: what is lost at most when the recorder is killed."""
PER_CHANNEL: Final = 10
"""Bytes that a chunk adds to the index at the end of a file, for each of its channels; and 100 for itself."""
MOST_STREAMS: Final = 60_000
"""Keys whose last sequence number is remembered."""


@dataclass(frozen=True)
class Limits:
    """When a file is full."""

    size: int = 2_000_000_000
    """Bytes."""
    seconds: Duration | None = None
    """Wall seconds; None = no limit."""
    split: bool = False
    """Whether the recording continues in another file then."""


class Filter:
    """Leaves out samples that were received before; takes them in order."""

    def __init__(self, minds: Minds, *, several: bool) -> None:
        """`minds` notes inputs and ends. `several`: a sample may arrive by more than one router."""
        self.wild = 0
        """Samples that were put on several keys by one expression."""
        self._minds, self._several = minds, several
        self._newest: dict[str, tuple[str, int]] = {}

    def new(self, heard: Heard) -> Heard | None:
        """Return what to write of a sample; None if it was received already, or each percept in it has its own."""
        if heard.key.endswith("/percepts"):
            return None
        if is_plain(heard.key):
            return heard if self._is_new(heard) else None
        self.wild += 1  # such a key is no topic
        payload = unread_payload(heard.payload, heard.encoding, deleted=heard.deleted, key=heard.key)
        return Heard(heard.at, NOTES, payload, codec(Unread).encodings["json"], "recorder")

    def _is_new(self, heard: Heard) -> bool:
        """Whether a sample is new: an answer may repeat what was put, and a second router what the first passed on."""
        if heard.origin == "token":
            self._token(heard)
        if heard.deleted or heard.origin in ("token", "recorder"):
            return True
        inputs = heard.key.endswith(PART)
        asked_for = "/percept/" in heard.key or heard.key.endswith("/manifest")
        if heard.origin == "put" and not (inputs or asked_for or self._several):
            return True
        head = head_of_payload(heard.payload, heard.encoding)
        if head is None or not head.header.boot:
            return True
        header = head.header
        if inputs and (parsed := keys.parse(heard.key)) is not None:
            return self._minds.heard(Whose(parsed[0], parsed[1], header.boot), head.number, final=head.final)
        boot, seq = self._newest.get(heard.key, ("", -1))
        old = boot == header.boot and header.seq <= seq
        if old and (self._several or heard.origin == "query"):
            return False
        if len(self._newest) >= MOST_STREAMS:
            self._newest.clear()
        self._newest[heard.key] = (header.boot, max(header.seq, seq) if boot == header.boot else header.seq)
        return True

    def _token(self, heard: Heard) -> None:
        """Note an agent that has lost its token."""
        seen = codec(TokenSeen).decode(heard.payload)
        if not seen.alive and (parsed := keys.parse_alive(seen.key)) is not None and parsed[2] == "agentd":
            self._minds.agent_left(Whose(parsed[0], parsed[1], parsed[3]))


class Recorder:
    """Writes one recording."""

    def __init__(
        self,
        path: Path,
        facts: Facts,
        limits: Limits,
        write_queue: WriteQueue,
        *,
        compression: Compression = "lz4",
        overwrite: bool = False,
        several: bool = False,
    ) -> None:
        """Create the file. `several`: a sample may arrive by more than one router. Raises OSError.

        Refuses to split a recording where files with the names of its later parts exist.
        """
        self.path, self.write_queue, self.minds = path, write_queue, Minds()
        self.files = [path]
        self.problem = ""
        """Why it failed; empty = it did not."""
        self.filter = Filter(self.minds, several=several)
        self._limits, self._facts = limits, facts
        self._compression: Compression = compression
        self._overwrite = overwrite
        if limits.split and not overwrite and (there := self._in_the_way()) is not None:
            raise FileExistsError(errno.EEXIST, f"{there.name} exists, and would be its next part", str(path))
        self.writer = RecordingWriter(path, facts, compression, overwrite=overwrite)
        self._written = self._messages = 0
        """Bytes and messages of the earlier files."""
        self._since_flush = self._chunks = 0
        self._began = write_queue.now()
        self._reported_drops = 0
        self._why = self._ended_early = ""
        """Why it ended; and why, if that was too early."""
        self._stop = Event()
        self._thread = Thread(target=self._run, name="recorder", daemon=True)
        self._on_end: Callable[[], object] = lambda: None

    @property
    def size(self) -> int:
        """Bytes of all files so far."""
        return self._written + self.writer.size

    @property
    def messages(self) -> int:
        """Messages so far; after a failure those that are certainly in the file."""
        return self._messages + (self.writer.safe if self.problem else self.writer.messages)

    @property
    def dropped(self) -> int:
        """Messages that were received and are not in the file."""
        return self.write_queue.dropped + self.write_queue.too_large + self.writer.no_channel

    @property
    def seconds(self) -> float:
        """Since the beginning of the recording."""
        return (self.write_queue.now() - self._facts.started) / SECOND

    @property
    def why(self) -> str:
        """Why it ended."""
        return self.problem or self._why

    def start(self, on_end: Callable[[], object]) -> None:
        """Begin; `on_end` is called on the recorder's thread when it has ended for any reason."""
        self._on_end = on_end
        self._thread.start()

    def stop(self, why: str) -> None:
        """Write what is queued, then end."""
        self._why = self._why or why
        self._stop.set()
        self.write_queue.woken.set()

    def note(self, kind: str, text: str) -> None:
        """Record an event of the recorder itself."""
        payload = msgspec.json.encode(RecorderNote(kind=kind, text=text))
        self.write_queue.put(
            Heard(self.write_queue.now(), NOTES, payload, codec(RecorderNote).encodings["json"], "recorder")
        )

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                self.write_queue.woken.wait(PERIOD)
                self.write_queue.woken.clear()
                if not self._drain() or self._late():
                    break
            else:
                self._drain()  # what is still queued
            self._close(self._why)
            self.problem = self._ended_early
        except OSError as error:
            self.problem = f"cannot write {error.filename or self.writer.path}: {error.strerror or error}"
            self.writer.abandon()
        except Exception as error:  # a defect must not end in silence
            self.problem = f"defect in argosy: {type(error).__name__}: {error}"
            self.writer.abandon()
        finally:
            self._on_end()

    def _late(self) -> bool:
        """Whether the time limit of the file is reached and no other file follows."""
        limit = self._limits.seconds
        return (
            limit is not None
            and self.write_queue.now() - self._began >= limit * SECOND
            and not self._full(f"the time limit of {limit} is reached")
        )

    def _drain(self) -> bool:
        """Write what is queued. Returns whether there is room for more."""
        for heard in self.write_queue.take():
            if (new := self.filter.new(heard)) is not None and self.writer.add(new) is not None:
                self._since_flush += len(heard.payload) + 64
            if self._size_of_file() >= self._limits.size and not self._full(
                f"the size limit of {size(self._limits.size)} is reached"
            ):
                return False
        if self.dropped > self._reported_drops:
            self.note("dropped", f"{self.dropped - self._reported_drops} messages did not fit and are missing")
            self._reported_drops = self.dropped
        self.writer.flush()
        self._since_flush = 0
        self._chunks += 1
        return True

    def _size_of_file(self) -> int:
        """Upper estimate of the file's bytes if it ended now."""
        index = self._chunks * (100 + PER_CHANNEL * self.writer.channels)
        return self.writer.size + self._since_flush + index

    def _full(self, why: str) -> bool:
        """Continue in another file, if the recording is to be split. Returns whether it does."""
        if not self._limits.split:
            self._why = why
            return False
        facts = replace(self._facts, part=len(self.files) + 1)
        path = self.path.with_name(f"{self.path.stem}-{facts.part:04}{self.path.suffix}")
        try:
            following = RecordingWriter(path, facts, self._compression, overwrite=self._overwrite)
        except OSError as error:  # this file is completed all the same
            self._why = self._ended_early = f"cannot continue in {path}: {error.strerror or error}"
            return False
        self._close(why, following.path.name)
        self._written += self.writer.size
        self._messages += self.writer.messages
        self.writer = following
        self.files.append(path)
        self._since_flush = self._chunks = 0
        self._began = self.write_queue.now()
        return True

    def _in_the_way(self) -> Path | None:
        """Return a file that has the name of a later part."""
        parts = re.compile(rf"{re.escape(self.path.stem)}-\d{{4,}}{re.escape(self.path.suffix)}")
        return next((one for one in self.path.absolute().parent.glob("*") if parts.fullmatch(one.name)), None)

    def _close(self, why: str, following: str = "") -> None:
        self.writer.close(
            End(
                why=why,
                ended=self.write_queue.now(),
                dropped=self.write_queue.dropped + self.writer.no_channel,
                too_large=self.write_queue.too_large,
                gaps=tuple(self.minds.gaps()),
                following=following,
            )
        )
