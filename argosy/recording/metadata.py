"""The metadata of a recording: facts at its beginning, and its end if it ended in order."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Final
from zlib import crc32

import msgspec

from argosy.recording.mind_inputs import Gap
from schemas.wire.records import Finite, Int64

SECOND: Final = 1_000_000_000
"""Nanoseconds."""
BEGIN, END = "argosy", "argosy.end"
"""Names of the two metadata records."""
FORMAT = "2"
"""Version of the recording format; others are refused."""
_NOTE = "note."
_UNKNOWN = {"recording": "", "fleet": "*", "started": 0, "version": ""}
"""Values of required facts that a file lacks."""
_SUM = "crc32"
"""Checksum of the other metadata: MCAP has one for messages only."""


class Facts(msgspec.Struct, frozen=True):
    """Metadata of the beginning of a recording."""

    recording: str
    """Unique id; the parts of a split recording share it."""
    fleet: str
    """`*` = every fleet on the router."""
    started: Int64
    """Unix nanoseconds."""
    version: str
    """Release of Argosy."""
    mission: str = ""
    """Name of the mission, if the recorder was given its file."""
    mission_file: str = ""
    """File name of the mission, without its folder."""
    mission_text: str = ""
    only: tuple[str, ...] = ()
    """The recorded key expressions; empty = everything of the fleet."""
    speed: Finite = 1.0
    """Mission seconds per wall second."""
    part: int = 1
    """Number of the file in a split recording, from 1."""
    notes: dict[str, str] = {}
    """Notes of the operator, by name."""

    def metadata(self) -> dict[str, str]:
        """Return the content of the metadata record."""
        plain = {name: str(value) for name, value in msgspec.structs.asdict(self).items() if name != "notes"}
        fields = {"format": FORMAT, **plain, "only": " ".join(self.only), "speed": f"{self.speed:g}"}
        fields |= {_NOTE + name: text for name, text in self.notes.items()}
        return fields | {_SUM: _sum(fields)}


def _sum(fields: Mapping[str, str]) -> str:
    return f"{crc32(json.dumps(sorted(fields.items())).encode()):08x}"


def intact(metadata: Mapping[str, str]) -> bool:
    """Whether the checksum of metadata, if there is one, is right."""
    fields = dict(metadata)
    expected = fields.pop(_SUM, None)
    return expected is None or expected == _sum(fields)


def facts_of(metadata: Mapping[str, str]) -> Facts:
    """Return the facts in a metadata record. Raises ValueError for another format."""
    found = metadata.get("format", "")
    if found != FORMAT:
        raise ValueError(f"it has format {found or '?'}, this version of Argosy reads format {FORMAT}")
    notes = {name.removeprefix(_NOTE): text for name, text in metadata.items() if name.startswith(_NOTE)}
    fields = {**_UNKNOWN, **metadata, "only": metadata.get("only", "").split(), "notes": notes}
    return msgspec.convert(fields, Facts, strict=False)


class End(msgspec.Struct, frozen=True):
    """Metadata of the end of a recording."""

    why: str
    """Text: `ctrl-C`, `the time limit of 1h is reached`, `the disk is full`."""
    ended: Int64
    """Unix nanoseconds."""
    messages: int = 0
    """Messages written."""
    dropped: int = 0
    """Messages that did not fit in the queue to the disk."""
    too_large: int = 0
    """Messages larger than any record."""
    unread: int = 0
    """Messages written as bytes: neither a JSON nor a MessagePack object."""
    gaps: tuple[Gap, ...] = ()
    """Missing inputs of minds."""
    following: str = ""
    """Name of the file that continues it."""

    def metadata(self) -> dict[str, str]:
        """Return the content of the metadata record."""
        fields = {name: str(value) for name, value in msgspec.structs.asdict(self).items()}
        fields["gaps"] = msgspec.json.encode(self.gaps).decode()
        return fields | {_SUM: _sum(fields)}


def end_of(metadata: Mapping[str, str]) -> End:
    """Return the end in a metadata record. Raises ValueError if it cannot be read."""
    gaps = msgspec.json.decode(metadata.get("gaps", "[]"))
    return msgspec.convert({"why": "", "ended": 0, **metadata, "gaps": gaps}, End, strict=False)
