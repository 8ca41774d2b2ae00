"""Code of users, such as that of drivers and plug-ins: where it is, and what went wrong in it."""

from __future__ import annotations

import os
from pathlib import Path
from traceback import walk_tb
from types import FrameType

MISTAKES = (Exception, SystemExit)
"""Exceptions of users' code that are its own mistakes: it may not end the process."""
_ROOT = Path(__file__).parents[2]
_OURS = tuple(f"{_ROOT}/{package}/" for package in ("schemas", "commd", "bridged", "agentd", "argosy"))
_LIBRARY = str(Path(os.__file__).parent)
"""Both as in frames, with symbolic links unresolved."""


def describe_error(error: BaseException) -> str:
    """Return an exception in one line: its kind, its text, and where in the user's own code it came from."""
    text = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    if isinstance(error, SyntaxError) and error.filename:
        return f"{type(error).__name__}: {error.msg} ({error.filename}:{error.lineno})"
    own = [(frame, line) for frame, line in walk_tb(error.__traceback__) if _is_users(frame)]
    if not own:
        return text
    frame, line = own[-1]
    return f"{text} ({frame.f_code.co_filename}:{line}, in {frame.f_code.co_name})"


def _is_users(frame: FrameType) -> bool:
    return not frame.f_code.co_filename.startswith((_LIBRARY, "<", *_OURS))


def where(frame: FrameType | None) -> str:
    """Return the function of a frame: the innermost one of code that is not Argosy's, if there is one."""
    innermost = frame
    while frame is not None:
        if frame.f_code.co_name != "<module>" and _is_users(frame):
            return f"in {_function_of(frame)}, which has not returned"
        frame = frame.f_back
    return "" if innermost is None else f"in {_function_of(innermost)}"


def _function_of(frame: FrameType) -> str:
    return f"{frame.f_code.co_name} ({frame.f_code.co_filename}:{frame.f_lineno})"
