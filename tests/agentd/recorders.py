"""What listens to the course of minds in tests, as a recorder does."""

from commd.bus.bus import Bus
from schemas.wire import keys
from schemas.wire.mind_records import ActivityEvent, DecisionView, MindActivity, MindDecisions, MindInputs
from tests.support.buses import until


class Recorder:
    """Everything that one agent tells of its course, from now on."""

    def __init__(self, bus: Bus, agent: str, *channels: str) -> None:
        """`channels`: those that are listened to; all if none are named."""
        self.batches: dict[int, MindInputs] = {}
        self.life = ""
        """The first life that it has heard of: further ones are left out."""
        self.decided: list[MindDecisions] = []
        self.told: list[MindActivity] = []
        self._bus, self._agent = bus, agent
        wanted = channels or ("inputs", "decisions", "activity")
        if "inputs" in wanted:
            bus.subscribe(keys.trace(bus.fleet, agent, "inputs"), MindInputs, lambda _, batch: self._take(batch))
        if "decisions" in wanted:
            bus.subscribe(
                keys.trace(bus.fleet, agent, "decisions"), MindDecisions, lambda _, some: self.decided.append(some)
            )
        if "activity" in wanted:
            bus.subscribe(
                keys.trace(bus.fleet, agent, "activity"), MindActivity, lambda _, some: self.told.append(some)
            )

    def _take(self, batch: MindInputs) -> None:
        self.life = self.life or batch.header.boot
        if batch.header.boot == self.life:
            self.batches[batch.number] = batch

    async def catch_up(self) -> str:
        """Ask for what has been before; returns why there is none, empty if there is."""
        key = keys.trace(self._bus.fleet, self._agent, "inputs")
        errors = await self._bus.ask_all(key, MindInputs, 10.0, lambda _, batch: self._take(batch))
        return next(iter(errors.values()), "")

    async def until_cycle(self, cycle: int) -> None:
        """Wait until everything up to a cycle has been told."""
        await until(
            lambda: max((batch.last for batch in self.batches.values()), default=0) >= cycle,
            f"cycle {cycle} is published",
        )

    @property
    def inputs(self) -> list[MindInputs]:
        """The batches in order."""
        return [self.batches[number] for number in sorted(self.batches)]

    @property
    def decisions(self) -> list[DecisionView]:
        return [one for some in self.decided for one in some.decisions]

    @property
    def activity(self) -> list[ActivityEvent]:
        return [one for some in self.told for one in some.events]
