"""For how long a robot's agents have had nothing to do with it while it is in the air and nobody else has it.

Pure: what agents say of themselves in their health, the robot's state and the time go in.
"""

from __future__ import annotations

from collections.abc import Collection

LEAST = 3.0
"""Wall seconds at least, whatever the mission's speed: agents say once a second whether they are idle."""


class Idleness:
    """Judges the agents of one robot. It counts as idle only when each of them that is there says that it is idle.

    A client of `commd.client` never says so: it may act at any time.
    """

    def __init__(self, after: float) -> None:
        """`after`: mission seconds."""
        self._after = after
        self._idle: dict[str, bool] = {}
        self._since: tuple[float, float] | None = None
        """Mission and wall seconds."""

    def told(self, agent: str, idle: bool | None) -> None:
        """Take in the health of an agent; None: it does not say."""
        self._idle[agent] = idle is True

    def gone(self, agent: str) -> None:
        """A life of an agent has ended: what it said holds no longer."""
        self._idle.pop(agent, None)

    def look(self, there: Collection[str], unattended: bool, now: float, wall: float, *, lost: bool = False) -> float:
        """Return for how many mission seconds nobody has had the robot in hand; 0 until `after` is over.

        `lost`: the agent that answers for it is lost, so what others intend is nothing that they do with it.
        """
        idle = bool(there) and all(self._idle.get(agent, False) for agent in there)
        if not (unattended and (lost or idle)):
            self._since = None
            return 0.0
        if self._since is None:
            self._since = now, wall
        begun, begun_wall = self._since
        over = now - begun >= self._after and wall - begun_wall >= LEAST
        return now - begun if over else 0.0
