"""When mission second 0 was and how fast mission time goes: a page lets its clock run on by itself."""

from __future__ import annotations

from argosy.team import TeamModel
from schemas.mission import Mission


class MissionTime:
    """The clock of a fleet as its model has it, from every mind that is heard, whether a page is open or not."""

    def __init__(self, mission: Mission | None) -> None:
        self.speed = 1.0 if mission is None else mission.speed
        self.zero: float | None = None
        """Unix seconds; None = no mind has told yet."""

    def look(self, model: TeamModel) -> None:
        """Take what the model knows now."""
        self.speed, self.zero = model.clock.speed, model.clock.zero
