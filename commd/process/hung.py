"""Where a process was when its service manager ended it for hanging: the function that does not return is named."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path
from types import FrameType

_OURS = str(Path(__file__).parents[2])
_PACKAGES = ("schemas", "commd", "bridged", "agentd", "argosy")
_LIBRARY = str(Path(os.__file__).parent)
"""Both as frames have them, which know nothing of what a symbolic link leads to."""


def tell_when_aborted(tell: Callable[[str], None]) -> None:
    """Call `tell(words)` at SIGABRT, which is what a watchdog sends, and end by it.

    It is told by Python, so not while C code hangs; then the process just ends.
    """

    def aborted(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGABRT, signal.SIG_DFL)
        try:
            tell(f"ended by SIGABRT, as by a watchdog, {where(frame)}")
        finally:
            os.kill(os.getpid(), signal.SIGABRT)

    signal.signal(signal.SIGABRT, aborted)


def where(frame: FrameType | None) -> str:
    """Say in which function a frame is: the innermost one of somebody else's code, if there is one."""
    innermost = frame
    while frame is not None:
        file = frame.f_code.co_filename
        if frame.f_code.co_name != "<module>" and not file.startswith((_LIBRARY, "<")) and not _is_ours(file):
            return f"in {_said(frame)}, which has not returned"
        frame = frame.f_back
    return "" if innermost is None else f"in {_said(innermost)}"


def _said(frame: FrameType) -> str:
    return f"{frame.f_code.co_name} ({frame.f_code.co_filename}:{frame.f_lineno})"


def _is_ours(file: str) -> bool:
    return file.startswith(tuple(f"{_OURS}/{package}/" for package in _PACKAGES))
