"""Small fleets on a real bus, with bridges and agents that answer as they are told."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager

from commd.bus.bus import Bus, Query, open_bus
from schemas.wire import keys
from schemas.wire.mind_records import ActivityEvent, BeliefView, IntentionView, MindActivity, MindOrder, MindView
from schemas.wire.records import ActionStatus, Health, Note, Outcome, Perception, Perceptions, StopOrder
from schemas.wire.terms import Term
from tests.support.buses import until

FLEET = "sar"
HOME = (-27.604033, -48.518363)


class Robot:
    """A bridge that answers orders, and tells what its vehicle does."""

    def __init__(self, bus: Bus, name: str, agent: str, answer: Outcome | None, fleet: str = FLEET) -> None:
        self.bus, self.name, self.agent = bus, name, agent
        self.answer = answer
        """None: it does not answer at all."""
        self.notes: tuple[Note, ...] = ()
        self.orders: list[str] = []
        bus.serve(keys.stop(fleet, name), StopOrder, self._told)
        bus.token(keys.alive(fleet, name, "bridged", bus.boot))

    async def _told(self, query: Query[StopOrder]) -> None:
        self.orders.append(query.record.order)
        if self.answer is not None:
            query.reply(self.answer)

    def tell(self, *position: float, mode: str = "GUIDED") -> None:
        """Tell where it is."""
        self.percept("state", mode, True, True)
        self.percept("home_pos", *HOME)
        self.percept("global_pos", *(position or HOME))
        self.percept("altitude", 20.0)
        self.percept("heading", 90)

    def percept(self, name: str, *parameters: Term) -> None:
        told = Perception(header=self.bus.header("percepts"), name=name, parameters=parameters)
        self.bus.put(keys.percepts(FLEET, self.agent), Perceptions(changes=(told,)))

    def healthy(self) -> None:
        """Tell that it is well, and whom it serves."""
        told = Health(daemon="bridged", percepts={self.agent: "b:1:0"}, notes=self.notes)
        self.bus.put(keys.health(FLEET, self.name, "bridged"), told)

    def gone(self, name: str) -> None:
        told = Perception(header=self.bus.header("percepts"), name=name, update="remove")
        self.bus.put(keys.percepts(FLEET, self.agent), Perceptions(changes=(told,)))

    def action(self, number: int, name: str, state: str, *parameters: Term, reason: str = "") -> None:
        record = ActionStatus(
            id=f"{self.agent}:1:{number}", state=state, name=name, parameters=parameters, reason=reason
        )  # type: ignore[arg-type]
        self.bus.put(keys.status(FLEET, self.agent, name), record)


class Agent:
    """An agent that shows a mind and takes orders, if it may."""

    def __init__(self, bus: Bus, name: str, inject: bool = True) -> None:
        self.bus, self.name, self.inject = bus, name, inject
        self.ordered: list[MindOrder] = []
        self.view = MindView(
            agent=name,
            program="scout.asl",
            cycle=3,
            intentions=(IntentionView(id=1, state="waiting", stack=("+!lane(2)", "+!search"), at="scout.asl:31"),),
            beliefs=(BeliefView(text="height(20)[source(self)]", sources=("self",), since=1.0),),
        )
        bus.serve(keys.mind(FLEET, name), MindView, self._mind)
        bus.serve(keys.control(FLEET, name), MindOrder, self._control)
        bus.token(keys.alive(FLEET, name, "agentd", bus.boot))

    async def _mind(self, query: Query[MindView]) -> None:
        query.reply(self.view)

    async def _control(self, query: Query[MindOrder]) -> None:
        assert query.record is not None
        self.ordered.append(query.record)
        query.reply(Outcome(ok=self.inject, reason="" if self.inject else "the mission does not say `inject: true`"))

    def activity(self, **fields: object) -> None:
        """Tell something that it did."""
        told = MindActivity(agent=self.name, events=(ActivityEvent(**fields),))  # type: ignore[arg-type]
        self.bus.put(keys.trace(FLEET, self.name, "activity"), told)


@asynccontextmanager
async def router(endpoint: str) -> AsyncIterator[Bus]:
    async with open_bus(endpoint, fleet=FLEET, name="board", daemon="commd", mode="router") as bus:
        yield bus


@asynccontextmanager
async def fleet(
    endpoint: str, robots: dict[str, Outcome | None], agents: tuple[str, ...] = ("scout",), inject: bool = True
) -> AsyncIterator[tuple[list[Robot], list[Agent]]]:
    """A router, bridges with their answers, and agents; the first robot is the first agent's, and so on."""
    async with AsyncExitStack() as stack:
        await stack.enter_async_context(router(endpoint))

        async def client(name: str, daemon: str) -> Bus:
            opened = open_bus(endpoint, fleet=FLEET, name=name, daemon=daemon)
            bus = await stack.enter_async_context(opened)
            await until(lambda: bus.router_up, "the router is there")
            return bus

        minds = [Agent(await client(name, "agentd"), name, inject) for name in agents]
        pairs = zip(robots.items(), (*agents, *("nobody" for _ in robots)), strict=False)
        craft = [Robot(await client(name, "bridged"), name, agent, answer) for (name, answer), agent in pairs]
        telling = asyncio.create_task(_healthy(craft, minds))
        stack.callback(telling.cancel)
        yield craft, minds


async def _healthy(robots: list[Robot], agents: list[Agent]) -> None:
    while True:
        for agent in agents:
            agent.bus.put(keys.health(FLEET, agent.name, "agentd"), Health(daemon="agentd"))
        for robot in robots:
            robot.healthy()
        await asyncio.sleep(0.5)
