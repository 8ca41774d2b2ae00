"""Reads recordings: the one reader of all that look into them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import zenoh
from mcap.records import Channel, Message, Metadata, Schema

from argosy.recording.facts import BEGIN, END, End, Facts, end_of, facts_of
from argosy.recording.lives import PART, Life, lives_of
from argosy.recording.mcap_records import BadRecording, McapFile
from argosy.recording.plain_keys import fleet_of, is_plain
from argosy.recording.records import PREFIX, RECORDS
from schemas import keys
from schemas.codec import BadRecord, codec
from schemas.minds import MindInputs
from schemas.records import Record

__all__ = ["BadRecording", "Recorded", "Recording", "Topic", "open_recording"]
R = TypeVar("R", bound=Record)
SECOND = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Track:
    """A channel of a file: a key, and what is said there."""

    key: str
    name: str
    """Of the record, such as `Perception`; empty = JSON of others."""
    encoding: str
    """As it was on the bus; the recording itself holds JSON."""
    origin: str
    """`put`, `query` (an answer, so it was there before), `token` or `recorder`."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """A message of a recording."""

    track: Track
    at: int
    """Unix nanoseconds at which the recorder took it."""
    stamp: int
    """Unix nanoseconds that its header has; that of `at` if it has none."""
    seconds: float
    """Since the beginning of the recording."""
    data: bytes
    """JSON."""

    @property
    def key(self) -> str:
        """The key on which it was said."""
        return self.track.key

    @property
    def name(self) -> str:
        """Name of its record; empty = none of ours."""
        return self.track.name

    @property
    def origin(self) -> str:
        """`put`, `query`, `token` or `recorder`."""
        return self.track.origin

    @property
    def record(self) -> Record | None:
        """The record, decoded anew each time; None for what is none of ours, or does not decode."""
        kind = RECORDS.get(self.name)
        if kind is None:
            return None
        try:
            return codec(kind).decode(self.data)
        except BadRecord:
            return None


@dataclass(frozen=True)
class Topic:
    """What was said on a key, all together."""

    key: str
    record: str
    messages: int


class Recording:
    """A recording: all its files, read from front to back as often as one likes."""

    def __init__(self, path: Path) -> None:
        """Open it. Raises BadRecording."""
        self.path = path
        self.files: list[Path] = []
        self.topics: list[Topic] = []
        self.end: End | None = None
        """How it ended; None: it was cut off."""
        self.missing = ""
        """What is missing of a file that was cut off, in one line; empty = nothing."""
        self.begin = self.last = 0
        """Unix nanoseconds of the first and the last message."""
        self.facts = self._look_through()

    @property
    def fleets(self) -> list[str]:
        """The fleets of which something was recorded."""
        return sorted({fleet for topic in self.topics if (fleet := fleet_of(topic.key)) is not None})

    @property
    def seconds(self) -> float:
        """From the first to the last message."""
        return (self.last - self.begin) / SECOND

    def messages(
        self,
        begin: float | None = None,
        end: float | None = None,
        only: Iterable[str] = (),
        records: Iterable[type[Record]] = (),
    ) -> Iterator[Recorded]:
        """Yield what was recorded from `begin` to before `end` (seconds since the beginning), in order.

        `only`: key expressions, of which one must match; `records`: types, of which it must be one. None = all.
        """
        since = self.begin if begin is None else self.begin + round(begin * SECOND)
        until = None if end is None else self.begin + round(end * SECOND)
        wanted = _Wanted(only, records)
        for track, message in self._read(wanted):
            at = message.log_time
            if at >= since and (until is None or at < until):
                yield Recorded(track, at, message.publish_time, (at - self.begin) / SECOND, message.data)

    def typed(self, record: type[R], only: Iterable[str] = ()) -> Iterator[tuple[Recorded, R]]:
        """Yield the messages that hold a record of this type, with it; what does not decode is left out."""
        for message in self.messages(only=only, records=(record,)):
            found = message.record
            if isinstance(found, record):
                yield message, found

    def lives(self, agent: str | None = None) -> list[Life]:
        """Return the lives of the minds that were recorded, or of one agent's."""
        key = f"{keys.ROOT}/*/{agent or '*'}/{PART}"
        return lives_of((message.key, batch) for message, batch in self.typed(MindInputs, (key,)))

    def _look_through(self) -> Facts:
        """Read all of it once: what there is, and whether it is whole."""
        counts: dict[tuple[str, str], int] = {}
        facts: Facts | None = None
        path: Path | None = self.path
        while path is not None:
            file, self.end = McapFile(path), None
            mine = self._look_into(file, counts)
            if facts is not None and (mine is None or mine.recording != facts.recording):
                break  # a file of another recording that has this name
            if facts is None and mine is None:
                raise BadRecording(f"{path}: no recording of Argosy{_because(file)}")
            facts = facts or mine
            self.files.append(path)
            following = self.end.following if self.end is not None else ""
            path = path.with_name(Path(following).name) if following else None
            if path is not None and not path.exists():
                self.missing = f"{path}: is missing, in which the recording goes on"
                path = None
        assert facts is not None
        self.topics = [Topic(key, name, count) for (key, name), count in sorted(counts.items())]
        self.begin = self.begin or facts.started
        self.last = max(self.last, self.begin)
        return facts

    def _look_into(self, file: McapFile, counts: dict[tuple[str, str], int]) -> Facts | None:
        facts: Facts | None = None
        channels: dict[int, tuple[str, str]] = {}
        names: dict[int, str] = {}
        for record in file.records():
            match record:
                case Message():
                    if record.channel_id in channels:
                        topic = channels[record.channel_id]
                        counts[topic] = counts.get(topic, 0) + 1
                    self.begin = min(self.begin or record.log_time, record.log_time)
                    self.last = max(self.last, record.log_time)
                case Schema():
                    names[record.id] = _record_name(record)
                case Channel():
                    channels[record.id] = (record.topic, names.get(record.schema_id, ""))
                case Metadata(name=name) if name == BEGIN:
                    try:
                        facts = facts_of(record.metadata)
                    except ValueError as error:
                        raise BadRecording(f"{file.path}: {error}") from None
                case Metadata(name=name) if name == END:
                    try:
                        self.end = end_of(record.metadata)
                    except ValueError as error:
                        raise BadRecording(f"{file.path}: how it ended cannot be read: {error}") from None
        if file.damage is not None and facts is not None:
            self.missing = self._what_is_missing(file, facts)
        return facts

    def _what_is_missing(self, file: McapFile, facts: Facts) -> str:
        damage = file.damage
        assert damage is not None
        until = (self.last - facts.started) / SECOND if self.last else 0.0
        left = f"; {damage.left} bytes behind that are of no use" if damage.left else ""
        if self.end is not None:
            return f"{file.path}: {damage.why}: all messages are there{left}"
        return f"{file.path}: {damage.why}: what was said after its first {until:.1f} s is missing{left}"

    def _read(self, wanted: _Wanted) -> Iterator[tuple[Track, Message]]:
        for path in self.files:
            tracks: dict[int, Track | None] = {}
            names: dict[int, str] = {}
            for record in McapFile(path).records():
                match record:
                    case Message():
                        if (track := tracks.get(record.channel_id)) is not None:
                            yield track, record
                    case Schema():
                        names[record.id] = _record_name(record)
                    case Channel():
                        tracks[record.id] = wanted.track(record, names.get(record.schema_id, ""))


class _Wanted:
    """Which channels are asked for."""

    def __init__(self, only: Iterable[str], records: Iterable[type[Record]]) -> None:
        self._only = [zenoh.KeyExpr(key) for key in only]
        self._names = {record.__name__ for record in records}

    def track(self, channel: Channel, name: str) -> Track | None:
        if self._names and name not in self._names:
            return None
        if self._only and not (is_plain(channel.topic) and self._matches(channel.topic)):
            return None
        said = channel.metadata
        return Track(channel.topic, name, said.get("encoding", ""), said.get("origin", "put"))

    def _matches(self, topic: str) -> bool:
        key = zenoh.KeyExpr(topic)
        return any(one.intersects(key) for one in self._only)


def _record_name(schema: Schema) -> str:
    return schema.name.removeprefix(PREFIX) if schema.name.startswith(PREFIX) else ""


def _because(file: McapFile) -> str:
    return f": {file.damage.why} before it says of what" if file.damage is not None else ": of somebody else"


def open_recording(path: Path) -> Recording:
    """Open a recording, with the files in which it goes on. Raises BadRecording for what is none."""
    return Recording(path)
