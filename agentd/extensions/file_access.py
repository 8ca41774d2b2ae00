"""Which files the programs of a mission may name at run time: those of the mission to read, a folder of state to write.

A program that a message can change must not reach beyond: paths are resolved, links included, before they are judged.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from commd.process.state_dir import make_private_file, make_private_folder, state_directory

KEPT = "kept_in"
"""In the agent's folder: the name of the checkpoint that has its state."""
MOST_SAVED = 16 * 2**20
"""Bytes of program text that ``.save_agent`` writes at most."""


class NotAllowed(ValueError):
    """A path outside of the folders of the mission; the message lists them."""


def allowed(path: str | Path, folders: Iterable[Path]) -> Path:
    """Return a path with its links resolved. Raises NotAllowed if it leads out of all the folders."""
    found, within = Path(os.path.realpath(path)), [folder.resolve() for folder in folders]
    if not any(found.is_relative_to(folder) for folder in within):
        raise NotAllowed(f"{path} is outside of {' and '.join(map(str, dict.fromkeys(within)))}")
    return found


class AgentFiles:
    """The files of one agent: ``folders`` to read from, the first for relative paths; ``state`` to write to."""

    def __init__(self, folders: list[Path], state: Path) -> None:
        self._folders = [folder.resolve() for folder in folders]
        self._state = state

    def readable(self, path: str, beside: str) -> Path:
        """Return the file that the program ``beside`` names.

        It is looked for beside that program, in the mission's folders, then among what was saved. Raises NotAllowed,
        and FileNotFoundError.
        """
        places = [Path(beside).resolve().parent, *self._folders, self._state.resolve()]
        allowed = [*self._folders, self._state.resolve()]
        outside = False
        for place in dict.fromkeys(places):
            found = Path(os.path.realpath(place / path))  # unlike `resolve` also of links in a loop
            if not any(found.is_relative_to(folder) for folder in allowed):
                outside = True
            elif found.is_file():
                return found
        if outside:
            raise NotAllowed(f"{path} is outside of {' and '.join(map(str, allowed))}")
        raise FileNotFoundError(f"there is no file {path} in {', '.join(map(str, dict.fromkeys(places)))}")

    def save(self, path: str, text: str) -> None:
        """Write a file of the state, whole or not at all. Raises NotAllowed and OSError."""
        if len(text) > MOST_SAVED:
            raise NotAllowed(f"{len(text)} characters are more than may be saved ({MOST_SAVED})")
        folder = self._state.resolve()
        target = (folder / path).resolve()
        if not target.is_relative_to(folder) or target == folder:
            raise NotAllowed(f"{path} is outside of {folder}, where agents save")
        if target.name == KEPT:
            raise NotAllowed(f"{path} is where the agent itself is kept")
        make_private_folder(target.parent)
        beginning = target.with_name(f".{target.name}.{os.getpid()}")
        try:
            make_private_file(beginning)
            beginning.write_text(text, encoding="utf-8")
            beginning.replace(target)
        finally:
            beginning.unlink(missing_ok=True)


def state_folder(given: str | None, fleet: str) -> Path:
    """Return where the agents of a fleet are kept: below what was asked for, systemd's state folder, or the user's."""
    return state_directory(None if given is None else Path(given)) / fleet
