"""The recorder: a thread that writes what was heard, once a second, until it is told to end or a limit is reached."""

from __future__ import annotations

import errno
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event, Thread
from typing import Final

import msgspec

from argosy.recording.file.metadata import SECOND, End, Facts
from argosy.recording.file.records import PREFIX, RecorderNote
from argosy.recording.file.write_queue import Heard, WriteQueue
from argosy.recording.file.writer import Compression, RecordingWriter
from argosy.recording.record.filter import NOTES, Sieve
from argosy.recording.record.minds import Minds
from schemas.files.units import Duration
from schemas.humanize import size

PERIOD: Final = 1.0
"""Wall seconds between two chunks: what is lost at most when the recorder is killed."""
PER_CHANNEL: Final = 10
"""Bytes of a chunk's entry in the index at the end of a file, for each of its channels; and 100 for itself."""


@dataclass(frozen=True)
class Limits:
    """When a file is long enough."""

    size: int = 2_000_000_000
    """Bytes."""
    seconds: Duration | None = None
    """Of the wall; none = no limit."""
    split: bool = False
    """Whether it goes on in another file then."""


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
        """Make the file. `several`: the same may be heard by more than one way. Raises OSError.

        A recording that is to be split is not begun where a file is in the way of its later parts.
        """
        self.path, self.write_queue, self.minds = path, write_queue, Minds()
        self.files = [path]
        self.problem = ""
        """Why it could not go on, if it could not."""
        self._limits, self._facts, self._sieve = limits, facts, Sieve(self.minds, several=several)
        self._compression: Compression = compression
        self._overwrite = overwrite
        if limits.split and not overwrite and (there := self._in_the_way()) is not None:
            raise FileExistsError(errno.EEXIST, f"{there.name} is there already, in which it would go on", str(path))
        self._writer = RecordingWriter(path, facts, compression, overwrite=overwrite)
        self._written = self._messages = 0
        """Bytes and messages of the files before this one."""
        self._since_flush = self._chunks = 0
        self._began = write_queue.now()
        self._told_dropped = 0
        self._why = self._ended_early = ""
        """Why it ended, and why it did before it was to."""
        self._stop = Event()
        self._thread = Thread(target=self._run, name="recorder", daemon=True)
        self._on_end: Callable[[], object] = lambda: None

    @property
    def size(self) -> int:
        """Bytes of all files so far."""
        return self._written + self._writer.size

    @property
    def messages(self) -> int:
        """Messages so far; after a problem those that are in the file for sure."""
        return self._messages + (self._writer.safe if self.problem else self._writer.messages)

    @property
    def dropped(self) -> int:
        """Messages that were heard and are not in the file."""
        return self.write_queue.dropped + self.write_queue.too_large + self._writer.no_channel

    @property
    def wild(self) -> int:
        """Messages that were put on many keys at once."""
        return self._sieve.wild

    @property
    def unread(self) -> int:
        """Messages of this file that are in it as bytes."""
        return self._writer.unread

    @property
    def seconds(self) -> float:
        """Since the beginning of the recording."""
        return (self.write_queue.now() - self._facts.started) / SECOND

    @property
    def why(self) -> str:
        """Why it ended."""
        return self.problem or self._why

    def start(self, on_end: Callable[[], object]) -> None:
        """Begin; `on_end` is called on the recorder's thread when it has ended, for whatever reason."""
        self._on_end = on_end
        self._thread.start()

    def stop(self, why: str) -> None:
        """Tell it to write what waits and to end."""
        self._why = self._why or why
        self._stop.set()
        self.write_queue.woken.set()

    def note(self, kind: str, text: str) -> None:
        """Write down what happened to the recorder."""
        payload = msgspec.json.encode(RecorderNote(kind=kind, text=text))
        encoding = f"application/json;{PREFIX}{RecorderNote.__name__}/1"
        self.write_queue.put(Heard(self.write_queue.now(), NOTES, payload, encoding, "recorder"))

    def _run(self) -> None:
        try:
            self._record()
            self._close(self._why)
            self.problem = self._ended_early
        except OSError as error:
            self.problem = f"cannot write {error.filename or self._writer.path}: {error.strerror or error}"
            self._writer.abandon()
        except Exception as error:  # a defect must not end in silence
            self.problem = f"defect in argosy: {type(error).__name__}: {error}"
            self._writer.abandon()
        finally:
            self._on_end()

    def _record(self) -> None:
        """Write until it is told to end, and then what still waits; or until a limit is reached."""
        while not self._stop.is_set():
            self.write_queue.woken.wait(PERIOD)
            self.write_queue.woken.clear()
            if not self._drain() or self._late():
                return
        self._drain()

    def _late(self) -> bool:
        """Whether the file lasts as long as it may, and there is to be no other."""
        limit = self._limits.seconds
        return (
            limit is not None
            and self.write_queue.now() - self._began >= limit * SECOND
            and not self._full(f"{limit} are over")
        )

    def _drain(self) -> bool:
        """Write what waits. Returns whether there is room for more."""
        for heard in self.write_queue.take():
            if (new := self._sieve.new(heard)) is not None and self._writer.add(new) is not None:
                self._since_flush += len(heard.payload) + 64
            if self._size_of_file() >= self._limits.size and not self._full(f"{size(self._limits.size)} are full"):
                return False
        self._tell_dropped()
        self._flush()
        return True

    def _flush(self) -> None:
        self._writer.flush()
        self._since_flush = 0
        self._chunks += 1

    def _size_of_file(self) -> int:
        """Bytes that the file would have if it ended now, or some more."""
        index = self._chunks * (100 + PER_CHANNEL * self._writer.channels)
        return self._writer.size + self._since_flush + index

    def _full(self, why: str) -> bool:
        """Go on in another file, if that is wanted. Returns whether it does."""
        if not self._limits.split:
            self._why = why
            return False
        facts = replace(self._facts, part=len(self.files) + 1)
        path = self.path.with_name(f"{self.path.stem}-{facts.part:04}{self.path.suffix}")
        try:
            following = RecordingWriter(path, facts, self._compression, overwrite=self._overwrite)
        except OSError as error:  # this file is ended as it should be all the same
            self._why = f"cannot go on in {path}: {error.strerror or error}"
            self._ended_early = self._why
            return False
        self._close(why, following.path.name)
        self._written += self._writer.size
        self._messages += self._writer.messages
        self._writer = following
        self.files.append(path)
        self._since_flush = self._chunks = 0
        self._began = self.write_queue.now()
        return True

    def _in_the_way(self) -> Path | None:
        """Return a file that has the name of a later part."""
        parts = re.compile(rf"{re.escape(self.path.stem)}-\d{{4,}}{re.escape(self.path.suffix)}")
        return next((one for one in self.path.absolute().parent.glob("*") if parts.fullmatch(one.name)), None)

    def _close(self, why: str, following: str = "") -> None:
        self._writer.close(
            End(
                why=why,
                ended=self.write_queue.now(),
                dropped=self.write_queue.dropped + self._writer.no_channel,
                too_large=self.write_queue.too_large,
                gaps=tuple(self.minds.gaps()),
                following=following,
            )
        )

    def _tell_dropped(self) -> None:
        if self.dropped > self._told_dropped:
            self.note("dropped", f"{self.dropped - self._told_dropped} messages did not fit and are missing")
            self._told_dropped = self.dropped
