"""Finds the manifests and missions that ship with the project, in a checkout and in an installed wheel alike."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

_PACKAGE = Path(__file__).resolve().parent
_BASES = (_PACKAGE / "shipped", _PACKAGE.parent)


def shipped(kind: Literal["manifests", "missions"], name: str) -> Path | None:
    """Return the path of the shipped file `name` (`arducopter.toml`), or None if none ships under that name."""
    for base in _BASES:
        path = base / kind / name
        if path.is_file():
            return path
    return None


def shipped_names(kind: Literal["manifests", "missions"], suffix: str) -> list[str]:
    """Return the names, without suffix, of what ships: for error messages that say what there is."""
    return sorted({path.stem for base in _BASES for path in (base / kind).glob(f"*{suffix}")})
