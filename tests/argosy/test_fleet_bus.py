"""Questions to several boards at once: each one ends, whatever becomes of the boards."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator
from contextlib import aclosing
from typing import Any

import pytest

from argosy.fleet_bus import Boards, FleetBus
from commd.bus import Bus, BusClosed
from schemas.records import Mailboxes


def asked(monkeypatch: pytest.MonkeyPatch, *, opening: Exception | None = None, asking: Exception) -> list[str]:
    """Ask two boards, of which one is not reached for `opening`, and the other one fails; return what is said."""
    bus, boards = object.__new__(FleetBus), object.__new__(Boards)
    bus.boards, boards.homes = boards, {}

    async def opened() -> FleetBus:
        if opening is not None:
            raise opening
        return bus

    async def fails(*_: Any, **__: Any) -> AsyncGenerator[Any, None]:
        raise asking
        yield

    monkeypatch.setattr(Bus, "query", fails)

    async def body() -> list[str]:
        boards.opening = {"pi1": asyncio.create_task(opened()), "pi2": asyncio.create_task(opened())}
        async with aclosing(bus.query("argosy/f/*/mailboxes", None, Mailboxes, 1.0)) as replies:
            return [reply.error async for reply in replies]

    return asyncio.run(asyncio.wait_for(body(), 20))


def test_a_session_that_closes_while_it_is_asked_is_told_for_each_board(monkeypatch: pytest.MonkeyPatch) -> None:
    said = asked(monkeypatch, asking=BusClosed("session closed"))
    assert said == [f"board {board} is reached no longer: session closed" for board in ("pi1", "pi2")]


def test_a_defect_while_boards_are_asked_is_raised_and_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UnicodeError, match="label"):
        asked(monkeypatch, asking=UnicodeError("label too long"))
    with pytest.raises(UnicodeError, match="host"):
        asked(monkeypatch, opening=UnicodeError("host"), asking=AssertionError())
