"""What manifests may name as sprayer.temperature: the board's temperature."""

from pathlib import Path

__all__ = ["temperature"]

ZONE = Path("/sys/class/thermal/thermal_zone0/temp")


def temperature() -> float:
    """Degrees Celsius. An OSError is told once, and the percept goes by its ttl."""
    return int(ZONE.read_text()) / 1000
