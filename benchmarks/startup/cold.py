"""Starting programs as for the first time: from a copy of the code without byte code, or with the page cache dropped.

The kernel lets go of a page only where nobody has it mapped: of what the processes that run share (the interpreter,
Zenoh's library) some stays. `Cache.left` says how much.
"""

from __future__ import annotations

import ctypes
import json
import mmap
import os
import shutil
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.results import ROOT

CODE: Final = ("schemas", "commd", "bridged", "agentd", "argosy", "missions", "manifests")
_MODULES: Final = """
import json, sys
import agentd.daemon, argosy.deploy.board_command, bridged.drivers.mavlink.registration
found = {sys.executable}
for module in list(sys.modules.values()):
    for name in ("__file__", "__cached__"):
        found.add(getattr(module, name, None) or sys.executable)
found |= {line.split(None, 5)[5].strip() for line in open("/proc/self/maps") if ".so" in line}
print(json.dumps(sorted(found)))
"""


def copied(folder: Path, *, compiled: bool) -> Path:
    """Copy the code into a folder, with its byte code or without any. Returns where it is.

    What byte code there is already is copied with the times of its files, by which Python knows whether it is right.
    """
    left = ("*.pyc.*",) if compiled else ("__pycache__",)  # somebody may be writing the former
    for name in CODE:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, folder / name, ignore=shutil.ignore_patterns(*left))
    if compiled:
        subprocess.run([sys.executable, "-m", "compileall", "-q", str(folder)], check=True)
    return folder


def environment(code: Path) -> tuple[str, ...]:
    """Return what stands before a command so that it runs the code of a folder, and leaves that as it is."""
    return ("env", f"PYTHONPATH={code}", "PYTHONDONTWRITEBYTECODE=1")


def files(code: Path) -> list[Path]:
    """Return the files that the daemons of a copy are loaded from, those of Python and of libraries among them."""
    command = [*environment(code), sys.executable, "-P", "-c", _MODULES]
    found = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    return [path for path in map(Path, found) if path.is_file()]


@dataclass(frozen=True)
class Cache:
    """How much of some files is in memory, in MB."""

    left: float
    size: float


def dropped(paths: Iterable[Path]) -> Cache:
    """Let the kernel drop files from its page cache, and look at what it has kept all the same."""
    os.sync()  # it drops no page that is not on the disk yet
    left = size = 0
    for path in paths:
        with path.open("rb") as file:
            os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
            here, pages = _resident(file.fileno())
        left, size = left + here, size + pages
    return Cache(left * mmap.PAGESIZE / 1e6, size * mmap.PAGESIZE / 1e6)


def _resident(file: int) -> tuple[int, int]:
    """Return how many pages of an open file are in memory, and how many it has."""
    length = os.fstat(file).st_size
    if not length:
        return 0, 0
    libc = ctypes.CDLL(None, use_errno=True)
    libc.mmap.restype = ctypes.c_void_p
    libc.mmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t, *[ctypes.c_int] * 3, ctypes.c_long]
    libc.mincore.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p]
    libc.munmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t]
    where = libc.mmap(None, length, mmap.PROT_READ, mmap.MAP_SHARED, file, 0)
    pages = -(-length // mmap.PAGESIZE)
    there = (ctypes.c_ubyte * pages)()
    try:
        if libc.mincore(where, length, there):
            raise OSError(ctypes.get_errno(), "mincore")
    finally:
        libc.munmap(where, length)
    return sum(byte & 1 for byte in there), pages
