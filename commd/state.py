"""Where a daemon keeps what must outlive it."""

from __future__ import annotations

import os
from pathlib import Path


def state_directory(given: Path | None) -> Path:
    """Return what was asked for, systemd's folder of state, or the user's; fleets have folders below it."""
    if given is not None:
        return given
    if systemd := os.environ.get("STATE_DIRECTORY"):
        return Path(systemd.partition(":")[0])
    base = os.environ.get("XDG_STATE_HOME") or (Path.home() / ".local" / "state" if "HOME" in os.environ else ".")
    return Path(base) / "argosy"
