"""The memory that processes hold, seen from outside: as the kernel shares it out, and as on a machine of their own."""

from __future__ import annotations

import array
from collections.abc import Iterable
from pathlib import Path
from typing import Final

MEGABYTE: Final = 1_000_000
"""Bytes: MB is 10^6 of them in all results and on all pages."""
_PAGE: Final = 4096
_PRESENT: Final = 1 << 63
_FRAME: Final = (1 << 55) - 1


def pss(pids: Iterable[int]) -> float:
    """Return the proportional set size of processes in MB: what they share with others is counted in parts."""
    return sum(_pss(pid) for pid in pids) * 1024 / MEGABYTE


def _pss(pid: int) -> int:
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines():
        if line.startswith("Pss:"):
            return int(line.split()[1])
    raise OSError(f"no Pss of process {pid}")


def alone(pids: Iterable[int]) -> float | None:
    """Return what processes hold in MB if nobody else shares anything with them: each page frame is counted once.

    None where the kernel does not tell the frames (it tells root).
    """
    frames: set[int] = set()
    for pid in pids:
        frames |= _frames(pid)
    return None if frames <= {0} else len(frames) * _PAGE / MEGABYTE


def _frames(pid: int) -> set[int]:
    found: set[int] = set()
    with open(f"/proc/{pid}/maps", encoding="utf-8") as maps, open(f"/proc/{pid}/pagemap", "rb", 0) as pages:
        for line in maps:
            if "[v" in line:  # the kernel's own pages
                continue
            begin, end = (int(address, 16) for address in line.split()[0].split("-"))
            pages.seek(begin // _PAGE * 8)
            entries = array.array("Q")
            entries.frombytes(pages.read((end - begin) // _PAGE * 8))
            found.update(entry & _FRAME for entry in entries if entry & _PRESENT)
    return found
