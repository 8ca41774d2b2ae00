"""Processes of tests that say `there` when they are, and are killed at the end."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager

from tests.support.processes import ROOT


@contextmanager
def there(*arguments: str) -> Iterator[None]:
    """Run `python ARGUMENTS` while the block runs, which begins when it says that it is there."""
    command = [sys.executable, *arguments]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == b"there\n"
            yield
        finally:
            process.kill()


def crowd_of(agents: int, endpoint: str) -> AbstractContextManager[None]:
    """Let so many simulated agents be on the bus."""
    return there("-m", "tests.argosy.fleet_model.crowd", endpoint, str(agents))
