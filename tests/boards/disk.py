"""A small disk of a board's own (tmpfs), which can be full for a while."""

from __future__ import annotations

import errno
import itertools
import os
import re
import subprocess
from pathlib import Path
from types import TracebackType

_OURS = re.compile(r"argosy-disk-(\d+)-\d+$")
_BLOCK = 1 << 20
_count = itertools.count()


class Disk:
    """A file system of so many MB at a path, as long as the block lasts."""

    def __init__(self, path: Path, megabytes: int) -> None:
        self.path, self._size = path, megabytes
        self._ballast = path / "ballast"

    def __enter__(self) -> Disk:
        _unmount_left()
        self.path.mkdir(parents=True, exist_ok=True)
        name = f"argosy-disk-{os.getpid()}-{next(_count)}"
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={self._size}m", name, str(self.path)], check=True)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        subprocess.run(["umount", "--lazy", str(self.path)], check=True)

    def fill(self) -> None:
        """Leave no byte free."""
        block = b"\0" * _BLOCK
        with self._ballast.open("wb", buffering=0) as ballast:
            while block:
                try:
                    ballast.write(block)
                except OSError as full:
                    if full.errno != errno.ENOSPC:
                        raise
                    block = block[: len(block) // 2]

    def free(self) -> None:
        """End a `fill`."""
        self._ballast.unlink(missing_ok=True)


def _unmount_left() -> None:
    """Remove the disks of runs that ended without removing them."""
    for line in Path("/proc/mounts").read_text().splitlines():
        name, path = line.split()[:2]
        found = _OURS.match(name)
        if found is not None and not os.path.exists(f"/proc/{found[1]}"):
            subprocess.run(["umount", "--lazy", path], check=False)
