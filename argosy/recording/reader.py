"""Read recordings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import zenoh
from mcap.records import Channel, Message, Metadata, Schema

from argosy.recording.mcap_records import BadRecording as BadRecording
from argosy.recording.mcap_records import Damage, McapFile
from argosy.recording.metadata import BEGIN, END, SECOND, End, Facts, end_of, facts_of, intact
from argosy.recording.mind_inputs import PART, RecordedMind
from argosy.recording.records import PREFIX, RECORDS, fleet_of, is_plain
from schemas.humanize import count, printable
from schemas.wire import keys
from schemas.wire.codec import BadRecord, codec
from schemas.wire.mind_records import MindInputs
from schemas.wire.records import Record


@dataclass(frozen=True, slots=True)
class Track:
    """A channel of a file: a key and the record on it."""

    key: str
    name: str
    """Record name, such as `Perception`; empty = not one of ours."""
    encoding: str
    """Encoding on the bus; the recording itself holds JSON."""
    origin: str
    """`put`, `query` (an answer), `token` or `recorder`."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """A message of a recording."""

    track: Track
    at: int
    """Unix nanoseconds at which the recorder received it."""
    stamp: int
    """Unix nanoseconds of its header; `at` if it has none."""
    seconds: float
    """Since the beginning of the recording."""
    data: bytes
    """JSON."""

    @property
    def key(self) -> str:
        """The key it was published on."""
        return self.track.key

    @property
    def name(self) -> str:
        """Record name; empty = not one of ours."""
        return self.track.name

    @property
    def origin(self) -> str:
        """`put`, `query`, `token` or `recorder`."""
        return self.track.origin

    @property
    def record(self) -> Record | None:
        """The record, decoded at each access; None if it is not one of ours or does not decode."""
        kind = RECORDS.get(self.name)
        if kind is None:
            return None
        try:
            return codec(kind).decode(self.data)
        except BadRecord:
            return None


@dataclass(frozen=True)
class Topic:
    """The messages of one record on one key."""

    key: str
    record: str
    messages: int


R = TypeVar("R", bound=Record)


class Recording:
    """A recording: all its files, read front to back, any number of times."""

    def __init__(self, path: Path) -> None:
        """Read it once, and the files that continue it. Raises BadRecording."""
        self.path = path
        self.files: list[Path] = []
        self.topics: list[Topic] = []
        self.end: End | None = None
        """How it ended; None = it was cut off."""
        self._lacks: list[str] = []
        self.begin = self.last = 0
        """Unix nanoseconds of the first and the last message."""
        self.facts = self._look_through()

    @property
    def missing(self) -> str:
        """The gaps of its files, as one line; empty = none."""
        return printable("; ".join(self._lacks))

    @property
    def fleets(self) -> list[str]:
        """The recorded fleets."""
        return sorted({fleet for topic in self.topics if (fleet := fleet_of(topic.key)) is not None})

    def names_of(self, record: type[Record]) -> list[tuple[str, str]]:
        """Return fleet and name of each key with records of this type, in the order of the keys."""
        parsed = (keys.parse(topic.key) for topic in self.topics if topic.record == record.__name__)
        return list(dict.fromkeys(one[:2] for one in parsed if one is not None))

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
        """Yield the messages from `begin` to before `end` (seconds since the beginning), in order.

        `only`: key expressions, one of which must match; `records`: accepted types. Empty = all.
        """
        since = self.begin if begin is None else self.begin + round(begin * SECOND)
        until = None if end is None else self.begin + round(end * SECOND)
        wanted = _Wanted(only, records)
        for track, message in self._read(wanted):
            at = message.log_time
            if at >= since and (until is None or at < until):
                yield Recorded(track, at, message.publish_time, (at - self.begin) / SECOND, message.data)

    def typed(self, record: type[R], only: Iterable[str] = ()) -> Iterator[tuple[Recorded, R]]:
        """Yield the messages that hold a record of this type, with the record; skip those that do not decode."""
        for message in self.messages(only=only, records=(record,)):
            found = message.record
            if isinstance(found, record):
                yield message, found

    def minds(self, agent: str | None = None, unread: Counter[tuple[str, str]] | None = None) -> list[RecordedMind]:
        """Return the recorded minds of all agents, or of one, ordered by their first batch in the file.

        Adds to `unread` the number of batches that do not decode, by fleet and agent.
        """
        found: dict[tuple[str, str, str], dict[int, MindInputs]] = {}
        only = f"{keys.ROOT}/*/{agent or '*'}/{PART}"
        for message in self.messages(only=(only,), records=(MindInputs,)):
            if (parsed := keys.parse(message.key)) is None:
                continue
            if isinstance(batch := message.record, MindInputs):
                found.setdefault((parsed[0], parsed[1], batch.header.boot), {}).setdefault(batch.number, batch)
            elif unread is not None:
                unread[parsed[0], parsed[1]] += 1
        return [
            RecordedMind(*whose, [batches[number] for number in sorted(batches)]) for whose, batches in found.items()
        ]

    def _look_through(self) -> Facts:
        """Read all files once, to count messages and find what is missing."""
        counts: dict[tuple[str, str], int] = {}
        file = McapFile(self.path)
        facts = _facts_of(file)
        if facts is None:
            why = f"{file.damage.why} before its facts" if file.damage is not None else "another program wrote it"
            raise BadRecording(f"{self.path}: not a recording of Argosy: {why}")
        if facts.part > 1:
            self._lacks.append(f"{self.path}: is part {facts.part} of a recording: the earlier parts are other files")
        while True:
            self._look_into(file, facts, counts)
            self.files.append(file.path)
            following = Path(self.end.following).name if self.end is not None else ""
            if not following:
                break
            path = file.path.with_name(following)
            if not _is_there(path):
                self._lacks.append(f"{path}: is missing: the recording continues in it")
                break
            if (next_one := _part(path, facts, facts.part + len(self.files))) is None:
                self._lacks.append(f"{path}: belongs to another recording, but has the name of the next part")
                break
            file = next_one
        if self.end is not None and (lost := self.end.dropped + self.end.too_large):
            self._lacks.append(f"{self.path}: {count(lost, 'message')} did not fit when it was recorded")
        self.topics = [Topic(key, name, number) for (key, name), number in sorted(counts.items())]
        self.begin = self.begin or facts.started
        self.last = max(self.last, self.begin)
        return facts

    def _look_into(self, file: McapFile, facts: Facts, counts: dict[tuple[str, str], int]) -> None:
        """Read a file of it once."""
        self.end, there = None, 0
        channels: dict[int, tuple[str, str]] = {}
        names: dict[int, str] = {}
        for record in file.records():
            if isinstance(record, Metadata) and not intact(record.metadata):
                self._lacks.append(f"{file.path}: its metadata `{record.name}` are damaged")
            match record:
                case Message():
                    if record.channel_id in channels:
                        topic = channels[record.channel_id]
                        counts[topic] = counts.get(topic, 0) + 1
                        there += 1
                    self.begin = min(self.begin or record.log_time, record.log_time)
                    self.last = max(self.last, record.log_time)
                case Schema():
                    names[record.id] = _record_name(record)
                case Channel():
                    channels[record.id] = (record.topic, names.get(record.schema_id, ""))
                case Metadata(name=name) if name == END:
                    try:
                        self.end = end_of(record.metadata)
                    except ValueError as error:
                        raise BadRecording(f"{file.path}: its metadata `{END}` cannot be read: {error}") from None
        if self.end is not None and there < self.end.messages:
            lost = f"{self.end.messages - there} of its {self.end.messages} messages"
            self._lacks.append(f"{file.path}: {lost} are missing: it is damaged, or was changed")
        elif file.damage is not None:
            self._lacks.append(self._what_is_missing(file.path, file.damage, facts))

    def _what_is_missing(self, path: Path, damage: Damage, facts: Facts) -> str:
        until = (self.last - facts.started) / SECOND if self.last else 0.0
        left = f"; {damage.left} bytes after that are unusable" if damage.left else ""
        if self.end is not None:
            return f"{path}: {damage.why}: all messages are there{left}"
        return f"{path}: {damage.why}: everything after its first {until:.1f} s is missing{left}"

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


def _facts_of(file: McapFile) -> Facts | None:
    """Return the facts at the beginning of a file; None if it has none. Raises BadRecording."""
    for record in file.records():
        if isinstance(record, Message):
            break
        if isinstance(record, Metadata) and record.name == BEGIN:
            try:
                return facts_of(record.metadata)
            except ValueError as error:
                raise BadRecording(f"{file.path}: {error}") from None
    return None


def _is_there(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # a recording may name any file: this name is too long
        return False


def _part(path: Path, facts: Facts, number: int) -> McapFile | None:
    """Return the file at `path`; None if it is not that part of the recording."""
    try:
        file = McapFile(path)
        mine = _facts_of(file)
    except BadRecording:
        return None
    return file if mine is not None and (mine.recording, mine.part) == (facts.recording, number) else None


class _Wanted:
    """Selects channels."""

    def __init__(self, only: Iterable[str], records: Iterable[type[Record]]) -> None:
        self._only = [zenoh.KeyExpr(key) for key in only]
        self._names = {record.__name__ for record in records}

    def track(self, channel: Channel, name: str) -> Track | None:
        if self._names and name not in self._names:
            return None
        if self._only and not is_plain(channel.topic):
            return None
        if self._only and not any(one.intersects(zenoh.KeyExpr(channel.topic)) for one in self._only):
            return None
        metadata = channel.metadata
        return Track(channel.topic, name, metadata.get("encoding", ""), metadata.get("origin", "put"))


def _record_name(schema: Schema) -> str:
    return schema.name.removeprefix(PREFIX) if schema.name.startswith(PREFIX) else ""
