"""The metadata of a recording: facts at its beginning, and its end if it ended in order."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final
from zlib import crc32

import msgspec

from argosy.recording.mind_inputs import Gap

SECOND: Final = 1_000_000_000
"""Nanoseconds."""
BEGIN, END = "argosy", "argosy.end"
"""Names of the two metadata records."""
FORMAT = "2"
"""Version of the recording format; others are refused."""
_NOTE = "note."
_SUM = "crc32"
"""Checksum of the other metadata: MCAP has one for messages only."""


@dataclass(frozen=True)
class Facts:
    """Metadata of the beginning of a recording."""

    recording: str
    """Unique id; the parts of a split recording share it."""
    fleet: str
    """`*` = every fleet on the router."""
    started: int
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
    speed: float = 1.0
    """Mission seconds per wall second."""
    part: int = 1
    """Number of the file in a split recording, from 1."""
    notes: Mapping[str, str] = field(default_factory=dict)
    """Notes of the operator, by name."""

    def metadata(self) -> dict[str, str]:
        """Return the content of the metadata record."""
        fields = {
            "format": FORMAT,
            "recording": self.recording,
            "fleet": self.fleet,
            "started": str(self.started),
            "version": self.version,
            "mission": self.mission,
            "mission_file": self.mission_file,
            "mission_text": self.mission_text,
            "only": " ".join(self.only),
            "speed": f"{self.speed:g}",
            "part": str(self.part),
        } | {_NOTE + name: text for name, text in self.notes.items()}
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
    return Facts(
        recording=metadata.get("recording", ""),
        fleet=metadata.get("fleet", "*"),
        started=int(metadata.get("started", "0")),
        version=metadata.get("version", ""),
        mission=metadata.get("mission", ""),
        mission_file=metadata.get("mission_file", ""),
        mission_text=metadata.get("mission_text", ""),
        only=tuple(metadata.get("only", "").split()),
        speed=float(metadata.get("speed", "1")),
        part=int(metadata.get("part", "1")),
        notes={name.removeprefix(_NOTE): text for name, text in metadata.items() if name.startswith(_NOTE)},
    )


@dataclass(frozen=True)
class End:
    """Metadata of the end of a recording."""

    why: str
    """Text: `ctrl-C`, `1 h are over`, `the disk is full`."""
    ended: int
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
        figures = {name: str(getattr(self, name)) for name in ("ended", "messages", "dropped", "too_large", "unread")}
        fields = {
            "why": self.why,
            **figures,
            "gaps": msgspec.json.encode(self.gaps).decode(),
            "following": self.following,
        }
        return fields | {_SUM: _sum(fields)}


def end_of(metadata: Mapping[str, str]) -> End:
    """Return the end in a metadata record. Raises ValueError if it cannot be read."""
    figures = {name: int(metadata.get(name, "0")) for name in ("ended", "messages", "dropped", "too_large", "unread")}
    try:
        gaps = msgspec.json.decode(metadata.get("gaps", "[]"), type=tuple[Gap, ...])
    except msgspec.MsgspecError as error:
        raise ValueError(f"gaps: {error}") from None
    return End(why=metadata.get("why", ""), gaps=gaps, following=metadata.get("following", ""), **figures)
