"""What runs beside a test: processes that say `there` when they are, and what serves in a thread of its own."""

import asyncio
import subprocess
import sys
import threading
from collections.abc import Callable, Coroutine, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

from tests.support.processes import PATIENCE, ROOT


@contextmanager
def there(*arguments: str) -> Iterator[None]:
    """Run `python ARGUMENTS` while the block runs, which begins when it says that it is there."""
    command = [sys.executable, *arguments]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout.readline() == b"there\n"
            yield
        finally:
            process.kill()


def crowd_of(agents: int, endpoint: str) -> AbstractContextManager[None]:
    """Let so many simulated agents be on the bus."""
    return there("-m", "tests.argosy.fleet_model.crowd", endpoint, str(agents))


@contextmanager
def beside(
    serve: Callable[[], Coroutine[Any, Any, None]], ready: threading.Event, stop: threading.Event
) -> Iterator[None]:
    """Run what serves in a thread of its own, from when it is ready until it is told to stop."""
    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    try:
        assert ready.wait(PATIENCE)
        yield
    finally:
        stop.set()
        thread.join(PATIENCE)
