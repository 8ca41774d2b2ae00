"""A run of Argosy under way: each line that it writes is kept, and heard."""

import asyncio
import signal
import sys
from collections.abc import Callable
from pathlib import Path

from tests.support.processes import ROOT

_LEAVE = 60.0
"""Wall seconds that a run has to end when it is told to."""


async def watched(command: tuple[str, ...], log: Path, hears: Callable[[str], None], patience: float) -> int | None:
    """Run `python -m COMMAND`; each line goes to `log` and `hears`. Returns its exit code.

    None: it has not ended within `patience` wall seconds, and was ended with all that it had started.
    """
    run = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", *command),
        cwd=ROOT,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
        limit=2**20,
    )
    try:
        await asyncio.wait_for(_read(run, log, hears), patience)
        return run.returncode
    except TimeoutError:
        return None
    finally:
        if run.returncode is None:
            run.send_signal(signal.SIGTERM)
            try:
                await asyncio.wait_for(run.wait(), _LEAVE)
            except TimeoutError:
                run.kill()  # the kernel ends what it has started


async def _read(run: asyncio.subprocess.Process, log: Path, hears: Callable[[str], None]) -> None:
    assert run.stdout is not None
    with log.open("w", encoding="utf-8") as file:
        async for raw in run.stdout:
            line = raw.decode(errors="replace").rstrip()
            file.write(line + "\n")
            file.flush()
            hears(line)
    await run.wait()
