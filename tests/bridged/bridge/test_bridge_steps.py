"""How often a bridge steps: each step wakes its process."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from pathlib import Path

import pytest

from tests.bridged.sky import Sky
from tests.support.buses import virtual_test


@pytest.mark.parametrize(("armed", "expected"), [(False, 10), (True, 40)])
@virtual_test
async def test_a_robot_without_actions_and_held_back_percepts_is_stepped_seldom(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, armed: bool, expected: int
) -> None:
    sky = Sky(tmp_path)
    sky.driver.vehicle.armed = armed
    step, seen = sky.bridge.step, list[float]()

    def counted() -> float:
        seen.append(step())
        return seen[-1]

    monkeypatch.setattr(sky.bridge, "step", counted)
    with suppress(TimeoutError):
        async with asyncio.timeout(9.99):
            await sky.bridge._pass_time()
    assert len(seen) == expected
