"""The files of an earlier revision, with today's benchmarks in them: product of then, probes of now."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from benchmarks.processes import BenchmarkFailed
from benchmarks.results import ROOT

CODE: Final = ("schemas", "commd", "bridged", "agentd", "argosy", "benchmarks")
OURS: Final = ("benchmarks", "tests/support")
"""Folders that are taken as they are now."""


@contextmanager
def tree(revision: str) -> Iterator[Path]:
    """Return a folder with that revision's files while the block lasts. Raises BenchmarkFailed."""
    with tempfile.TemporaryDirectory(prefix="argosy-earlier-") as made:
        folder = Path(made)
        archive = folder / "earlier.tar"
        command = ["git", "archive", "--output", str(archive), revision]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60, check=False)
        if done.returncode:
            raise BenchmarkFailed(
                f"revision {revision} is not in this clone ({done.stderr.strip() or 'git failed'}); "
                "a clone has its whole history after `git fetch --unshallow`, a copy without .git has none"
            )
        shutil.unpack_archive(archive, folder, filter="data")
        archive.unlink()
        for name in OURS:
            shutil.rmtree(folder / name, ignore_errors=True)
            shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
        # as `make bench` does here: otherwise what is started there would compile all at each start
        subprocess.run([sys.executable, "-m", "compileall", "-q", *(str(folder / name) for name in CODE)], check=True)
        yield folder
