"""When daemons look for garbage."""

import asyncio
import gc
from collections.abc import Iterator

import pytest

from commd.process import garbage


@pytest.fixture(autouse=True)
def as_before() -> Iterator[None]:
    threshold = gc.get_threshold()
    yield
    gc.set_threshold(*threshold)


def test_what_a_daemon_has_loaded_is_not_looked_through_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(garbage, "SETTLED", 0.0)
    loaded = [object]

    def looked_through() -> bool:
        return any(one is loaded for one in gc.get_objects())

    async def main() -> tuple[bool, bool]:
        garbage.look_seldom(1_000)
        before = looked_through()
        settled = asyncio.Event()
        asyncio.get_running_loop().call_later(0.0, settled.set)  # after that of `look_seldom`
        await settled.wait()
        return before, looked_through()

    assert asyncio.run(main()) == (True, False)
    assert gc.get_threshold()[0] == garbage.YOUNG + 1_000 * garbage.YOUNG_EACH
