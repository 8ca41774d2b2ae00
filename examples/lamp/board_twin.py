"""The simulated twin of `board_functions`: the same functions, with no board behind them."""

from __future__ import annotations

import time
from collections.abc import Iterator

__all__ = ["blink", "temperature"]

blinked: list[int] = []


def temperature() -> float:
    """It warms up with each blink."""
    return 40.0 + len(blinked)


def blink(times: int) -> Iterator[dict[str, float]]:
    for done in range(times):
        time.sleep(0.05)
        blinked.append(done)
        yield {"to_go": times - done - 1}
