"""Types that msgspec has not seen before: it looks at each when it is used first, and two threads at once crash it.

Seen with msgspec 0.22: two threads of a fresh process that read the same mission end it by SIGSEGV. Types that it knows
need no lock, so only files are converted under it, and each codec is made under it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, Final, TypeVar

import msgspec

T = TypeVar("T")

FIRST_USE: Final = threading.RLock()
"""Held while msgspec may look at a type."""


def convert(value: object, kind: type[T], dec_hook: Callable[[type, Any], Any]) -> T:
    """`msgspec.convert`, for files. Raises msgspec.ValidationError."""
    with FIRST_USE:
        return msgspec.convert(value, kind, dec_hook=dec_hook)
