"""Runs pip as a process of its own, and tells in words why it could not do what it was asked."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from importlib.util import find_spec

_NO_CONNECTION = (
    "NewConnectionError",
    "ConnectTimeout",
    "ReadTimeout",
    "NameResolutionError",
    "Temporary failure",
    "ProxyError",
)
"""What pip writes when it does not reach an index."""


class NoWheel(RuntimeError):
    """A wheel cannot be had; says why."""


class Offline(NoWheel):
    """No package index can be reached."""


def run_pip(arguments: Sequence[str], doing: str, patience: float) -> None:
    """Run `pip ARGUMENTS`, for at most `patience` wall seconds. Raises NoWheel, which says what it was `doing`."""
    if find_spec("pip") is None:
        raise NoWheel(f"{sys.executable} has no pip, which downloads wheels: {sys.executable} -m ensurepip")
    command = [sys.executable, "-m", "pip", *arguments, "--no-input", "--disable-pip-version-check"]
    try:
        done = subprocess.run(
            [*command, "--timeout=20", "--retries=2"],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=patience,
        )
    except subprocess.TimeoutExpired:
        raise NoWheel(f"{doing}: not done within {patience:.0f} s") from None
    if done.returncode == 0:
        return
    if any(word in done.stderr for word in _NO_CONNECTION):
        raise Offline(f"{doing}: no connection to the package index")
    told = [line.removeprefix("ERROR: ") for line in done.stderr.splitlines() if line.startswith("ERROR: ")]
    why = "; ".join(dict.fromkeys(told)) or done.stderr.strip()[-500:] or f"pip ended with exit code {done.returncode}"
    raise NoWheel(f"{doing}: {why}")
