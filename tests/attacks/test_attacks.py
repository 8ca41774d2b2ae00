"""Every attack of docs/attacks.md is refused, and what is allowed is not."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator

import pytest

from tests.attacks.links import LINKS
from tests.attacks.messages import MESSAGES
from tests.attacks.world import TEXT, Attack, World
from tests.support.secured import Secured


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    """One fleet for all attacks: it is to survive each of them."""
    with Secured(TEXT) as fleet:
        world = World(fleet)
        world.begin()
        yield world


@pytest.mark.parametrize("attack", [*LINKS, *MESSAGES], ids=lambda attack: str(attack.__name__))
def test_it_is_refused_and_what_is_allowed_is_not(world: World, attack: Attack) -> None:
    row = asyncio.run(asyncio.wait_for(attack(world), 90))
    assert row.problems == []
    assert row.seen
