"""What becomes of a transaction that nobody waits for any more."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path

import pytest

from commd.mail import schema
from commd.mail.store import StoreFailed, open_store
from tests.support.buses import async_test, until


@async_test
async def test_what_a_caller_was_told_to_have_failed_is_not_written_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commd.mail.store.PATIENCE", 0.2)
    async with open_store(tmp_path / "x.mail", "normal") as store:
        slow, began = threading.Event(), threading.Event()

        def hang(db: object) -> None:
            began.set()
            slow.wait(20)

        hanging = asyncio.create_task(store.write(hang))
        await until(began.is_set, "the disk hangs")
        with pytest.raises(StoreFailed, match="has not answered"):
            await store.write(lambda db: schema.keep(db, "test", "too late", b""))
        slow.set()
        await asyncio.gather(hanging, return_exceptions=True)
        await store.write(lambda db: schema.keep(db, "test", "in time", b""))
        assert list(await store.read(lambda db: schema.kept(db, "test"))) == ["in time"]
