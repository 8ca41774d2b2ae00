"""Find the state of each agent: a daemon keeps that of all its agents in one checkpoint.

The file is `STATE/FLEET/DAEMON.minds`, by the name of the daemon. The folder of each agent names the file that has its
state, so that a mission may give its agents to other daemons: their state moves with them.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Final

from msgspec import structs

from agentd.extensions.file_access import KEPT
from agentd.persistence.checkpoint import DAMAGED, Checkpoint, CheckpointError, Synchronous, remove
from agentd.persistence.restore import RestoredState
from commd.process.state_dir import make_private_folder, replace_file
from schemas.wire.records import Note

log = logging.getLogger("keeping")

ENDING: Final = ".minds"


def open_state(
    folder: Path, daemon: str, kept: Iterable[str], fresh: Iterable[str], synchronous: Synchronous
) -> tuple[Checkpoint | None, dict[str, RestoredState]]:
    """Open the checkpoint of a daemon, or make it. Return it, and the state of each agent that is `kept`.

    The old state of `fresh` agents is removed, unsent mail included, and that is logged. Without agents to keep there
    is no checkpoint. Blocks. Raises CheckpointError.
    """
    kept, fresh = list(kept), set(fresh)
    path = folder / f"{daemon}{ENDING}"
    if not (kept or path.exists() or any(_named(folder, agent) for agent in fresh)):
        return None, {}
    try:
        return _opened(folder, path, kept, fresh, synchronous)
    except OSError as error:
        raise CheckpointError(f"{path}: {error.strerror or error}") from None


def _opened(
    folder: Path, path: Path, kept: list[str], fresh: set[str], synchronous: Synchronous
) -> tuple[Checkpoint | None, dict[str, RestoredState]]:
    notes: list[Note] = []
    checkpoint = _open(path, synchronous, replace=fresh.issuperset(kept))
    try:
        notes += _move_in(folder, checkpoint, [agent for agent in kept if agent not in fresh], synchronous)
        found = checkpoint.read()
        for agent in fresh & found.keys():
            log.warning("agent=%s forgets what it was; messages=%d are lost", agent, len(found[agent].outgoing))
        if fresh:
            checkpoint.forget(fresh)
        states = {}
        for agent in kept:
            make_private_folder(folder / agent)
            if _named(folder, agent) != path.name:
                _name(folder, agent, path.name, sync=False)
            stored = None if agent in fresh else found.get(agent)
            states[agent] = RestoredState(path, folder / agent, stored, [*checkpoint.notes])
    except BaseException:
        checkpoint.close()
        raise
    for agent in fresh.difference(kept):
        forget_name(folder, agent)
    for note in (*checkpoint.notes, *notes):
        log.error("%s", note.text)
    for note in notes:
        states[note.about].notes.append(note)
    if kept:
        return checkpoint, states
    checkpoint.close()
    return None, {}


def _open(path: Path, synchronous: Synchronous, replace: bool) -> Checkpoint:
    """Open a file; `replace` one that is refused and in nobody's use. Raises CheckpointError."""
    try:
        return Checkpoint.open(path, synchronous)
    except CheckpointError as error:
        if not replace or error.__cause__ is not None:  # another process has it open, or the disk fails
            raise
        log.warning("what is kept is removed unread: %s", error)
        remove(path)
        return Checkpoint.open(path, synchronous)


def _move_in(folder: Path, into: Checkpoint, agents: Iterable[str], synchronous: Synchronous) -> list[Note]:
    """Move the state of agents that another file has. Return what is missing. Raises CheckpointError.

    Until the agent's folder names the new file, the old one counts.
    """
    elsewhere: dict[str, list[str]] = {}
    for agent in agents:
        name = _named(folder, agent)
        if name and name != into.path.name:
            elsewhere.setdefault(name, []).append(agent)
    notes: list[Note] = []
    for name, moved in elsewhere.items():
        path = folder / name
        if not path.exists():
            text = "{agent} starts without its state: the file {path} that had it is gone"
            notes += [Note(DAMAGED, text.format(agent=agent, path=path), agent) for agent in moved]
            continue
        try:
            other = Checkpoint.open(path, synchronous)
        except CheckpointError as error:
            whose = f"it has the state of {', '.join(moved)}"
            raise CheckpointError(f"{error}; {whose}: end the agentd that had them before, or use --fresh") from error
        try:
            found = other.read()
            into.forget(moved)  # an earlier move may have been cut short
            into.save({agent: found[agent].as_saving() for agent in moved if agent in found})
            for agent in moved:
                _name(folder, agent, into.path.name, sync=True)
            other.forget(moved)
        finally:
            other.close()
        notes += [structs.replace(note, about=agent) for note in other.notes for agent in moved]
        log.info("moved=%s from=%s to=%s", ",".join(moved), name, into.path.name)
    return notes


def _named(folder: Path, agent: str) -> str:
    """Return the name of the file that has the state of an agent; empty if none is named."""
    try:
        text = (folder / agent / KEPT).read_text(errors="replace")
    except (FileNotFoundError, NotADirectoryError):
        return ""
    name = text.removesuffix("\n")
    whole = text.endswith(f"{ENDING}\n") and "/" not in name  # a power failure may have cut it
    return name if whole else ""


def _name(folder: Path, agent: str, name: str, *, sync: bool) -> None:
    """Name the file that has the state of an agent. Raises OSError."""
    replace_file(folder / agent / KEPT, f"{name}\n".encode(), synced=sync)


def forget_name(folder: Path, agent: str) -> None:
    """Name no file: the agent begins without a past."""
    with suppress(OSError):
        (folder / agent / KEPT).unlink()
