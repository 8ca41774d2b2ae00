"""A crowd of simulated agents and robots on a real bus, to see whether an observer keeps up: `crowd ROUTER AGENTS`.

Each tells what a real one does, as often as a flying copter does: a token, health at 1 Hz, position and altitude at
10 Hz, how its action stands at 2 Hz, events at 4 Hz, and it shows its mind.
"""

import asyncio
import sys
from contextlib import AsyncExitStack, suppress

from commd.bus.bus import Bus, Query, open_bus
from schemas.wire import keys
from schemas.wire.mind_records import (
    ActivityEvent,
    BeliefView,
    IntentionView,
    MindActivity,
    MindView,
    PlanView,
    WaitView,
)
from schemas.wire.records import ActionStatus, Health, Mailboxes, Perception, Perceptions, Queue

FLEET = "crowd"
HOME = (-27.604033, -48.518363)


class Agent:
    """One agent with a robot of its own."""

    def __init__(self, bus: Bus, number: int) -> None:
        self.bus, self.number, self.name, self.robot = bus, number, f"agent{number:02}", f"uav{number:02}"
        self.steps = 0
        bus.token(keys.alive(FLEET, self.name, "agentd", "b"))
        bus.token(keys.alive(FLEET, self.robot, "bridged", "b"))
        bus.serve(keys.mind(FLEET, self.name), MindView, self._mind)

    async def _mind(self, query: Query[MindView]) -> None:
        detailed = query.parameters.get("plans") == "true"
        beliefs = tuple(
            BeliefView(text=f"seen({one},-27.6,-48.5)", sources=("percept",), since=1.0) for one in range(40)
        )
        intention = IntentionView(
            id=1,
            state="waiting",
            waits_for=WaitView(kind="action", name="goto"),
            stack=("+!visit(3)", "+!search"),
            at="scout.asl:31",
        )
        plans = tuple(PlanView(label=f"p{one}", trigger="+!visit(N)", position="scout.asl:30") for one in range(40))
        query.reply(
            MindView(
                agent=self.name,
                cycle=self.steps,
                time=self.steps / 10,
                intentions=(intention,) * 3,
                beliefs=beliefs if detailed else (),
                plans=plans if detailed else (),
                mailbox=self.number % 3,
            )
        )

    def step(self) -> None:
        """A tenth of a second passes."""
        self.steps += 1
        bus, away = self.bus, self.steps * 1e-6
        self._percept("altitude", 20.0 + self.steps % 10 / 10)
        self._percept("global_pos", HOME[0] + away, HOME[1] + self.number * 1e-4)
        if self.steps % 10 == 1:
            self._percept("state", "GUIDED", True, True)
            self._percept("home_pos", HOME[0], HOME[1] + self.number * 1e-4)
            bus.put(keys.health(FLEET, self.name, "agentd"), Health(daemon="agentd", lag=0.01))
            told = Health(daemon="bridged", percepts={self.name: f"b:{self.steps}:0"})
            bus.put(keys.health(FLEET, self.robot, "bridged"), told)
        if self.steps % 5 == 0:
            status = ActionStatus(
                id=f"{self.name}:b:{self.steps // 100}",
                state="succeeded" if self.steps % 100 == 95 else "running",
                name="goto",
                parameters=(HOME[0] + 1e-3, HOME[1], 20),
                feedback={"distance": 100.0 - self.steps % 100},
            )
            bus.put(keys.status(FLEET, self.name, "goto"), status)
        if self.steps % 3 == 0:
            event = ActivityEvent(
                kind="sent", id=f"m{self.steps}", other="agent00", performative="tell", text=f"at({self.steps})"
            )
            events = MindActivity(
                agent=self.name, events=(event, ActivityEvent(kind="print", text=f"step {self.steps}"))
            )
            bus.put(keys.trace(FLEET, self.name, "activity"), events)

    def _percept(self, name: str, *parameters: float | str | bool) -> None:
        told = Perception(header=self.bus.header("percepts", self.name), name=name, parameters=parameters)
        self.bus.put(keys.percepts(FLEET, self.name), Perceptions(changes=(told,)))


async def crowd(router: str, agents: int) -> None:
    """Be so many agents until the process is ended."""
    async with AsyncExitStack() as stack:
        buses = [
            await stack.enter_async_context(open_bus(router, fleet=FLEET, name=f"crowd{one}", daemon="crowd"))
            for one in range(max(1, agents // 10))
        ]
        board = buses[0]

        async def mailboxes(query: Query[Mailboxes]) -> None:
            waiting = Queue(box="inbox", sender="agent01", receiver="agent00", messages=2, oldest=3.0)
            query.reply(Mailboxes(board="board0", queues=(waiting,)), keys.mailboxes(FLEET, "board0"))

        board.token(keys.alive(FLEET, "board0", "commd", "b"))
        board.serve(keys.mailboxes(FLEET, "board0"), Mailboxes, mailboxes)
        them = [Agent(buses[number % len(buses)], number) for number in range(agents)]
        print("there", flush=True)
        until = asyncio.get_running_loop().time()
        while True:
            for agent in them:
                agent.step()
            told = Health(daemon="commd")
            board.put(keys.health(FLEET, "board0", "commd"), told)
            until += 0.1
            await asyncio.sleep(max(0.0, until - asyncio.get_running_loop().time()))


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        asyncio.run(crowd(sys.argv[1], int(sys.argv[2])))
