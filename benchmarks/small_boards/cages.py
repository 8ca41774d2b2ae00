"""Processes kept within the memory and the processor of a small board.

Where a control group can be made the kernel keeps them there (`control_groups`). Elsewhere they are watched from
outside (`watcher`): stopped and continued, and all killed when together they hold too much. `Cage.kind` says which it
was. A cage is made before its processes, and each is started by `Cage.command`.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from benchmarks.small_boards.control_groups import ControlGroup
from benchmarks.small_boards.limits import Cage, Limits
from benchmarks.small_boards.watcher import Watcher


@contextmanager
def caged(limits: Limits) -> Iterator[Cage]:
    """Make a cage and take it away behind the block, in which its processes have to end."""
    group = ControlGroup.made()
    if group is None:
        with tempfile.TemporaryDirectory() as folder:
            watcher = Watcher(limits, Path(folder) / "processes")
            try:
                yield watcher
            finally:
                watcher.end()
        return
    try:
        group.limit(limits)
        yield group
    finally:
        group.remove()
