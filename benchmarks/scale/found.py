"""What was found at one size."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from benchmarks.bridge.traffic import POSITIONS
from benchmarks.scale.daemons import Use
from benchmarks.scale.mission import Vehicles
from benchmarks.spread import NOTHING, Spread

BEAT_LATE: Final = 1.5
"""Seconds between two heartbeats of the bridge after which the second one is late: one is due each second."""
LATE: Final = 1000.0 / POSITIONS
"""Milliseconds from a position to its belief after which the next position is there already."""
IN_TIME: Final = 0.99
"""So large a part of the positions is to be a belief before the next one is due."""


@dataclass
class Run:
    """What was found at one size."""

    vehicles: Vehicles
    size: int
    own_links: bool
    """Each vehicle has a link, and so a bridge, of its own; otherwise all share one."""
    seconds: float
    serving: int = 0
    """Agents that served their vehicle within `PATIENCE`."""
    ready: float = 0.0
    """Seconds from the start of the first bridge until the last of these agents did."""
    busy: float = 0.0
    """Per cent of all cores of the machine."""
    use: dict[str, Use] = field(default_factory=dict)
    """By kind: commd, bridged, agentd, simulator, talkers."""
    messages: float = 0.0
    """MAVLink messages a second that bridges took in."""
    percepts: float = 0.0
    """Percepts a second that bridges told, as they count them."""
    percept: Spread = NOTHING
    """From the moment before a position is sent to the line that a plan prints for its belief."""
    unseen: int = 0
    """Positions that became no belief."""
    in_time: float = 1.0
    """So large a part of all positions that were sent were beliefs before the next one was due."""
    asked: Spread = NOTHING
    """From an action to its success: the vehicle is asked for a parameter."""
    actions: dict[str, int] = field(default_factory=dict)
    """How actions ended."""
    missed: dict[str, int] = field(default_factory=dict)
    """Deadlines that were missed, and what was lost."""
    lag: dict[str, float] = field(default_factory=dict)
    """Milliseconds by which daemons of a kind were behind at worst."""
    late_rounds: int = 0
    """Rounds of simulators more than 0.1 s late."""
    never_happened: float = 0.0
    """Seconds that simulators stood still and did not make up for, all together."""
    talkers_late: float = 0.0
    """Milliseconds by which talkers were late at worst."""

    @property
    def daemons(self) -> list[str]:
        """The kinds that are the product's."""
        return [kind for kind in ("commd", "bridged", "agentd") if kind in self.use]

    def cpu(self) -> float:
        """Per cent of a core, of all daemons."""
        return sum(self.use[kind].cpu for kind in self.daemons)

    def pss(self) -> float:
        """MB, of all daemons."""
        return sum(self.use[kind].pss for kind in self.daemons)

    def not_served(self) -> list[str]:
        """What this size did not get in time, in words; none: it got everything."""
        wanted = self.size + (self.vehicles == "copters")
        found = [f"agents that did not serve their vehicle: {wanted - self.serving}"] if self.serving < wanted else []
        if self.in_time < IN_TIME:
            found.append(f"{1 - self.in_time:.1%} of the positions were no belief when the next one was due")
        return found + [f"{what}: {count}" for what, count in self.missed.items() if count]
