"""A vehicle in flight, and the moments of what it shows by itself."""

import json
from collections.abc import Callable

from tests.support.processes import Daemon, poll


class Flight:
    """What the process of a vehicle (`tests.field.vehicle`) has told."""

    vehicle: Daemon

    def shown(self, after: float) -> list[tuple[float, str, bool]]:
        """Return the modes of the vehicle since a moment: when (seconds after it), which, and whether it is armed."""
        lines = [json.loads(line) for line in list(self.vehicle.lines) if line.startswith("{")]
        return [(line["at"] - after, line["mode"], line["armed"]) for line in lines if line["at"] > after]

    def shows(self, mode: str, after: float) -> float | None:
        """Return how many seconds after a moment the vehicle was in a mode first; None if it was not."""
        return next((at for at, shown, _ in self.shown(after) if shown == mode), None)

    def until(self, condition: Callable[[], bool], wish: str, seconds: float) -> None:
        """Wait until something holds."""
        poll(condition, wish, seconds, said=self.transcript)

    def until_shown(self, mode: str, after: float, seconds: float = 40) -> float:
        """Wait until the vehicle is in a mode; returns the seconds since `after`."""
        self.until(lambda: self.shows(mode, after) is not None, f"the vehicle is in {mode}", seconds)
        return self.shows(mode, after) or 0.0

    def transcript(self) -> str:
        """All that was said."""
        return self.vehicle.text
