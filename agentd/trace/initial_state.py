"""The initial state of a mind, recorded so that it can be rebuilt: program texts, settings, restored state."""

from __future__ import annotations

import base64
import binascii
import re
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, timedelta, timezone, tzinfo
from functools import lru_cache
from pathlib import Path
from typing import Final

import msgspec

from agentd.language.compiler.compile import CompiledProgram
from agentd.language.parse import parse_program, parse_source
from agentd.language.syntax_tree.nodes import Program
from agentd.language.syntax_tree.source import Source, read_source
from agentd.mind import Mind
from agentd.mind.data.inputs import Input
from agentd.mind.persistence.change_tracking import Keeper
from agentd.mind.persistence.rows import MindRows
from schemas.wire.mind_records import InitialMind

MOST_MEMORY: Final = 2_000_000
"""Bytes of restored state in a record, compressed; more does not fit."""
MOST_UNPACKED: Final = 64_000_000
"""The same, unpacked: a record of few bytes can be made that unpacks to gigabytes."""


@dataclass(slots=True)
class Sources:
    """The texts of an agent's program: its files, and what the mission file adds."""

    main: str = ""
    """The path of the main file, as it was read; empty: there is none."""
    mission: str = ""
    """The path of the mission file, as positions name it."""
    beliefs: tuple[str, ...] = ()
    """Those of the mission file, unparsed."""
    goals: tuple[str, ...] = ()
    on_restart: str = ""
    """The goal that a restarted agent pursues instead of its own pending goals; empty: none."""
    formulas: tuple[str, ...] = ()
    """The mission's `done` and `failed` formulas of this agent."""
    _packed: dict[str, bytes] = field(default_factory=dict)

    def parse_file(self, path: str | Path) -> Program:
        """Parse a file as `agentd.language.parse.parse_file` does, and keep its text."""
        return parse_source(lambda: self._read(path), path)

    def _read(self, path: str | Path) -> Source:
        source = read_source(path)
        self.keep(str(path), source.text)
        return source

    def keep(self, path: str, text: str) -> None:
        """Keep the text that was read from a path."""
        self._packed[path] = _packed(text)

    @property
    def files(self) -> dict[str, str]:
        """The texts by their paths."""
        return {path: zlib.decompress(packed).decode() for path, packed in self._packed.items()}


@lru_cache(maxsize=256)
def _packed(text: str) -> bytes:
    """Compress a text; agents of one process that run the same program share the result."""
    return zlib.compress(text.encode(), 6)


def parser_of(files: Mapping[str, str]) -> Callable[[str | Path], Program]:
    """Return what parses a text by its path, as `agentd.language.parse.parse_file` does a file.

    It raises FileNotFoundError.
    """

    def parse(path: str | Path) -> Program:
        text = files.get(str(path))
        if text is None:
            raise FileNotFoundError(2, "it is not in the recording", str(path))
        return parse_program(text, str(path))

    return parse


@dataclass(slots=True)
class InitialState:
    """The initial state of one mind; compressed only when `record` is called."""

    settings: InitialMind
    """The record without the texts of the program and the restored state."""
    sources: Sources | None = None
    stored: MindRows | None = None
    """The state restored after a restart."""
    unknown: str = ""
    """Why the mind cannot be rebuilt; empty: it can."""

    def record(self) -> InitialMind:
        """Return the complete record."""
        sources, unknown = self.sources or Sources(), self.unknown
        if self.sources is None:
            unknown = unknown or "the sources of its program were not kept"
        memory = "" if self.stored is None else pack(self.stored)
        if len(memory) > MOST_MEMORY:
            unknown = unknown or f"its restored state is too large to record: {len(memory)} bytes"
            memory = ""
        return msgspec.structs.replace(
            self.settings,
            program=sources.main,
            files=sources.files,
            mission=sources.mission,
            beliefs=sources.beliefs,
            goals=sources.goals,
            on_restart=sources.on_restart,
            formulas=sources.formulas,
            memory=memory,
            unknown=unknown,
        )


def make_mind(
    agent: str,
    program: CompiledProgram,
    settings: InitialMind,
    clock: Callable[[], float],
    agents: Callable[[], Iterable[str]],
    keeper: Keeper | None,
    decisions: int,
    on_input: Callable[[int, Input], None] | None = None,
) -> Mind:
    """Return a mind as it begins, also where it is replayed; it remembers its last `decisions`, 0 or more.

    `clock`, `agents` and `on_input` are the hooks of `Mind`. Raises ValueError for settings with an invalid time zone.
    """
    return Mind(
        agent,
        program,
        seed=settings.seed,
        start=settings.start,
        on_input=on_input,
        names_variables=settings.names_variables,
        clock=clock,
        agents=agents,
        has_team=settings.has_team,
        ask_timeout=settings.ask_timeout,
        epoch=settings.epoch,
        zone=zone_of(settings.zone),
        decisions=decisions,
        keeper=keeper,
    )


_ROWS: Final = msgspec.msgpack.Decoder(MindRows)


def pack(stored: MindRows) -> str:
    """Encode a stored mind as text: MessagePack, zlib, base64."""
    return base64.b64encode(zlib.compress(msgspec.msgpack.encode(stored), 1)).decode()


def unpack(text: str) -> MindRows:
    """Decode what `pack` has written. Raises ValueError."""
    unpacking = zlib.decompressobj()
    try:
        rows = unpacking.decompress(base64.b64decode(text, validate=True), MOST_UNPACKED)
        if not unpacking.eof:
            raise ValueError(f"it is cut off, or has more than {MOST_UNPACKED} bytes")
        return _ROWS.decode(rows)
    except (zlib.error, binascii.Error, msgspec.MsgspecError) as error:
        raise ValueError(str(error)) from None


_OFFSET: Final = re.compile(r"UTC(?:([+-])(\d\d):(\d\d)(?::(\d\d))?)?\Z")


def zone_of(text: str) -> tzinfo:
    """Return the time zone of a record. Raises ValueError."""
    match = _OFFSET.match(text)
    if match is None:
        raise ValueError(f"`{text}` is no offset from UTC")
    sign, hours, minutes, seconds = match.groups()
    if sign is None:
        return UTC
    offset = timedelta(hours=int(hours), minutes=int(minutes), seconds=int(seconds or 0))
    return timezone(offset if sign == "+" else -offset)
