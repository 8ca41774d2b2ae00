"""What a row of the fault table says: how the fault was injected, the outcome of each action, and its cost."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from schemas.wire.records import ActionStatus
from tests.soak.report import Judged, table


@dataclass(frozen=True)
class Ended:
    """How one action ended, and whether the robot's own state agrees."""

    call: str
    """As the agent wrote it."""
    finals: tuple[ActionStatus, ...]
    """Its final statuses: there must be one."""
    held: bool
    """Whether the robot's state showed what was wanted when the status came."""
    seconds: float
    """Mission seconds until then."""

    @property
    def problems(self) -> list[str]:
        """What is not as it must be."""
        if len(self.finals) != 1:
            return [f"{self.call}: {len(self.finals)} final statuses"]
        final = self.finals[0]
        if final.state == "succeeded" and not self.held:
            return [f"{self.call}: succeeded, and the robot's state says no"]
        if final.state != "succeeded" and not final.reason:
            return [f"{self.call}: {final.state} without a reason"]
        return []

    def __str__(self) -> str:
        final = self.finals[-1] if self.finals else None
        if final is None:
            return f"`{self.call}` without an end"
        reason = f": {final.reason}" if final.reason and final.state != "succeeded" else ""
        return f"`{self.call}` **{final.state}** after {self.seconds:.1f} s{reason}"


@dataclass
class Row(Judged):
    """One fault."""

    fault: str
    injected: str
    """How, and with what."""
    ended: list[Ended] = field(default_factory=list)
    bound: str = ""
    """What the memory was held to."""

    def wrong(self) -> list[str]:
        """Everything that is not as it must be."""
        return [*self.problems, *(problem for ended in self.ended for problem in ended.problems)]


Maker = Callable[[Path], Row]


def of_actions(rows: Sequence[Row]) -> list[str]:
    """The rows of actions as Markdown."""
    return table(
        "fault | injected | outcome of each action | also observed | memory",
        ((row.fault, row.injected, "<br>".join(map(str, row.ended)), "<br>".join(row.seen), row.bound) for row in rows),
    )


def of_mail(rows: Sequence[Row]) -> list[str]:
    """The rows without actions as Markdown."""
    cells = ((row.fault, row.injected, "<br>".join(row.seen), row.bound) for row in rows)
    return table("fault | injected | observed | memory", cells)
