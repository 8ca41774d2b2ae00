"""What tests of recordings have at hand."""

from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path

import pytest

from tests.argosy.recording.recorders import Studio
from tests.support.buses import Connect


@pytest.fixture
@asynccontextmanager
async def studio(connect: AbstractAsyncContextManager[Connect], endpoint: str, tmp_path: Path) -> AsyncIterator[Studio]:
    """Record and replay on a bus with a router at `endpoint`."""
    async with connect as opens:
        yield Studio(opens, endpoint, tmp_path)
