"""Functions of a Linux board for the driver `python`: its temperature, and its light (docs/guides/drivers.md)."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

__all__ = ["blink", "temperature"]

ZONE = Path("/sys/class/thermal/thermal_zone0/temp")
LIGHT = Path("/sys/class/leds/ACT/brightness")


def temperature() -> float:
    """Degrees Celsius. An OSError is told once, and the percept goes by its ttl."""
    return int(ZONE.read_text()) / 1000


def blink(times: int) -> Iterator[dict[str, float]]:
    """Blink; each `yield` is progress, and where the action can be cancelled: `finally` leaves the light off."""
    try:
        for done in range(times):
            for on in (1, 0):
                LIGHT.write_text(f"{on}\n")
                time.sleep(0.25)
            yield {"to_go": times - done - 1}
    finally:
        LIGHT.write_text("0\n")
