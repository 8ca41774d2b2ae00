"""Recordings made and looked at by tests."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jsonschema
from mcap.reader import make_reader

from argosy.recording.metadata import Facts
from argosy.recording.write_queue import Heard
from argosy.recording.writer import Compression, RecordingWriter
from schemas.wire import keys
from schemas.wire.codec import Wire, codec
from schemas.wire.mind_records import InitialMind, MindInputs
from schemas.wire.records import Header, Perception, Record

SECOND = 1_000_000_000
BEGIN = 1_700_000_000 * SECOND
FACTS = Facts(recording="abc", fleet="test", started=BEGIN, version="9.9.9")


def heard(key: str, record: Record, seconds: float = 0.0, wire: Wire = "json") -> Heard:
    """A record as it comes from the bus."""
    made = codec(type(record))
    return Heard(BEGIN + round(seconds * SECOND), key, made.encode(record, wire), made.encodings[wire])


def altitude(number: int, value: float, wire: Wire = "json") -> Heard:
    """The percept `altitude(value)`, said at second `number`."""
    header = Header(seq=number, stamp=BEGIN + number * SECOND - 5, source="uav1", boot="b1")
    record = Perception(header=header, name="altitude", parameters=(value,))
    return heard(keys.percept("test", "uav1", "altitude"), record, number, wire)


def stretch(number: int, boot: str = "b1", agent: str = "uav") -> MindInputs:
    initial = InitialMind(program="a.asl", files={"a.asl": "!go."}) if number == 0 else None
    header = Header(seq=number, stamp=1, boot=boot)
    return MindInputs(header=header, agent=agent, number=number, initial=initial, last=number)


def write(path: Path, messages: Sequence[Heard], compression: Compression = "lz4") -> RecordingWriter:
    """Write messages, each in a chunk of its own; the file is not ended."""
    writer = RecordingWriter(path, FACTS, compression, overwrite=True)
    for message in messages:
        writer.add(message)
        writer.flush()
    return writer


def validated(path: Path) -> int:
    """Let the format's own reader read a file and hold each message to its schema. Returns how many there are."""
    validators: dict[int, Any] = {}
    count = 0
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            if schema.id not in validators:
                text = json.loads(schema.data)
                assert text["type"] == "object"
                validators[schema.id] = jsonschema.Draft202012Validator(text)
            validators[schema.id].validate(json.loads(message.data))
            count += 1
    return count
