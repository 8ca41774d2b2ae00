"""What a recording says of itself: metadata at its beginning, and at its end if it came to one."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final
from zlib import crc32

SECOND: Final = 1_000_000_000
"""Nanoseconds."""
BEGIN, END = "argosy", "argosy.end"
"""Names of the two metadata records."""
FORMAT = "1"
"""Of recordings; another one is refused."""
_NOTE = "note."
_SUM = "crc32"
"""Of all else in the metadata: MCAP itself has a checksum for messages only."""


@dataclass(frozen=True)
class Facts:
    """What is known when a recording begins."""

    recording: str
    """A name for it that no other has; the parts of one that was split share it."""
    fleet: str
    """`*`: every fleet on the router."""
    started: int
    """Unix nanoseconds."""
    version: str
    """Of Argosy."""
    mission: str = ""
    """What the mission is called, if the recorder was given its file."""
    mission_file: str = ""
    """Name of that file, without its folder."""
    mission_text: str = ""
    only: tuple[str, ...] = ()
    """The key expressions to which it was limited; none = everything of the fleet."""
    speed: float = 1.0
    """Mission seconds that passed in a second of the clock on the wall."""
    part: int = 1
    """Counts up from 1 with the files of a recording that was split."""
    notes: Mapping[str, str] = field(default_factory=dict)
    """What whoever recorded wanted to have noted."""

    def metadata(self) -> dict[str, str]:
        """Return them as a metadata record's content."""
        said = {
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
        return said | {_SUM: _sum(said)}


def _sum(said: Mapping[str, str]) -> str:
    return f"{crc32(json.dumps(sorted(said.items())).encode()):08x}"


def intact(metadata: Mapping[str, str]) -> bool:
    """Whether metadata are as they were written, as far as they say so."""
    said = dict(metadata)
    expected = said.pop(_SUM, None)
    return expected is None or expected == _sum(said)


def facts_of(metadata: Mapping[str, str]) -> Facts:
    """Return the facts that a metadata record holds. Raises ValueError for another format."""
    found = metadata.get("format", "")
    if found != FORMAT:
        raise ValueError(f"a recording of format {found or '?'}, this version of Argosy reads format {FORMAT}")
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
    """What is known when a recording ends."""

    why: str
    """In words: `ctrl-C`, `1 h are over`, `the disk is full`."""
    ended: int
    """Unix nanoseconds."""
    messages: int = 0
    """All that were written."""
    dropped: int = 0
    """That did not fit in the queue to the disk."""
    too_large: int = 0
    """That were larger than any record may be."""
    unread: int = 0
    """That were neither JSON nor MessagePack of an object; they are in the file as bytes."""
    gaps: tuple[str, ...] = ()
    """What is missing of the inputs of minds, in words."""
    following: str = ""
    """Name of the file in which it goes on."""

    def metadata(self) -> dict[str, str]:
        """Return it as a metadata record's content."""
        figures = {name: str(getattr(self, name)) for name in ("ended", "messages", "dropped", "too_large", "unread")}
        said = {"why": self.why, **figures, "gaps": "\n".join(self.gaps), "following": self.following}
        return said | {_SUM: _sum(said)}


def end_of(metadata: Mapping[str, str]) -> End:
    """Return the end that a metadata record holds."""
    figures = {name: int(metadata.get(name, "0")) for name in ("ended", "messages", "dropped", "too_large", "unread")}
    gaps = tuple(metadata.get("gaps", "").splitlines())
    return End(why=metadata.get("why", ""), gaps=gaps, following=metadata.get("following", ""), **figures)
