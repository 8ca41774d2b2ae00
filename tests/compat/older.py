"""The daemons of an older version as they were, unpacked from the data of these tests."""

from __future__ import annotations

import tarfile
from pathlib import Path

DATA = Path(__file__).with_name("data")
VERSION = "0.1.0"
"""The oldest version that the present one works with."""


def unpack(folder: Path) -> Path:
    """Return a folder from which `python -m commd` and the like are those of the older version."""
    with tarfile.open(DATA / f"daemons-{VERSION}.tar.xz") as packed:
        packed.extractall(folder, filter="data")
    return folder
