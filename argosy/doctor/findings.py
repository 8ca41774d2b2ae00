"""The facts that `argosy doctor` gathers, and the findings it prints."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from argosy.fleet_model.fleet_status import Row
from schemas.mission.model import Mission
from schemas.wire.records import BoardReport, LinkReport, Mailboxes

Level: TypeAlias = Literal["ok", "warning", "error"]
"""`error`: the fleet does not work; `warning`: it may fail soon."""


@dataclass(frozen=True)
class Diagnosis:
    """A finding."""

    level: Level
    what: str
    """Subject, such as `clocks`."""
    text: str
    do: str = ""
    """Advice; empty for `ok`."""


@dataclass(frozen=True)
class RobotFacts:
    """The answers of a robot's bridge."""

    percepts: Mapping[str, int]
    """Present percepts by name, with the newest stamp of each: Unix nanoseconds of its board's clock."""
    declared: Mapping[str, Mapping[str, object]]
    """Percepts of its running manifest."""
    problem: str = ""
    """Why nothing is known; empty = the bridge has answered."""


@dataclass(frozen=True)
class Facts:
    """The gathered facts."""

    mission: Mission
    rows: Sequence[Row] = ()
    earlier: Sequence[Row] = ()
    """The same daemons some seconds earlier, for rates."""
    boards: Mapping[str, BoardReport | str] = field(default_factory=dict)
    """Answer of each board, or why there is none."""
    from_here: Mapping[str, LinkReport] = field(default_factory=dict)
    """Measured link from this machine to each board."""
    robots: Mapping[str, RobotFacts] = field(default_factory=dict)
    mail: Mapping[str, Mailboxes] = field(default_factory=dict)
    now: int = 0
    """Unix nanoseconds of this machine's clock when the percepts were queried."""

    @property
    def reports(self) -> dict[str, BoardReport]:
        """The boards that answered."""
        return {name: one for name, one in self.boards.items() if isinstance(one, BoardReport)}


Check: TypeAlias = Callable[[Facts], list[Diagnosis]]
