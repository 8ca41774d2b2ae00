"""What `argosy doctor` knows of a fleet, and what it says of it: findings, each with what to do."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from argosy.fleet_model.fleet_status import Row
from schemas.mission.model import Mission
from schemas.wire.records import BoardReport, LinkReport, Mailboxes

Level: TypeAlias = Literal["ok", "warning", "error"]
"""`error`: the fleet does not work as it should; `warning`: it may soon not."""


@dataclass(frozen=True)
class Said:
    """A finding, or that all is well."""

    level: Level
    what: str
    """What was looked at: `clocks`."""
    text: str
    do: str = ""
    """What to do; nothing if all is well."""


@dataclass(frozen=True)
class RobotFacts:
    """What a robot's bridge answers."""

    percepts: Mapping[str, int]
    """The present percepts by name, and when the newest of each was told: Unix nanoseconds of its board's clock."""
    declared: Mapping[str, Mapping[str, object]]
    """The percepts of its running manifest."""
    problem: str = ""
    """Why nothing is known, in words."""


@dataclass(frozen=True)
class Facts:
    """What was gathered, for the checks."""

    mission: Mission
    rows: Sequence[Row] = ()
    earlier: Sequence[Row] = ()
    """The same daemons some seconds before, for rates."""
    boards: Mapping[str, BoardReport | str] = field(default_factory=dict)
    """What each board answered, or why it did not."""
    from_here: Mapping[str, LinkReport] = field(default_factory=dict)
    """How each board is reached from this machine."""
    robots: Mapping[str, RobotFacts] = field(default_factory=dict)
    mail: Mapping[str, Mailboxes] = field(default_factory=dict)
    now: int = 0
    """Unix nanoseconds of this machine when the percepts were asked for."""

    @property
    def reports(self) -> dict[str, BoardReport]:
        """The boards that answered."""
        return {name: one for name, one in self.boards.items() if isinstance(one, BoardReport)}


Check: TypeAlias = Callable[[Facts], list[Said]]
