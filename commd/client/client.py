"""Join any Python program to a team: it has a name and a mailbox, perceives, and acts if it has a robot.

    async with join("planner", mission="survey.yaml") as me:
        await me.send("scout", "achieve", parse("survey(north)"))
        async for message in me.messages():
            print(message.sender, write(message.content))

Mail is as durable as that of agents: `send` returns when the message is on disk, and a received message is kept there
until the program is done with it. Acting on it exactly once is up to the program (docs/guides/mail.md).
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from commd.bus.bus import Bus, open_bus
from commd.bus.errors import AccessDenied, AlreadyRunning, BusClosed, BusError
from commd.client.actions import ActionRequests
from commd.client.percept_sync import PerceptSync
from commd.client.receive_mail import QUESTION, Messages, ProgramInbox
from commd.client.send_mail import MailboxFull, NotSendable, NotSent, Sending, SendTimeout, TooLarge, UnknownReceiver
from commd.common.clock import Clock
from commd.common.tasks import Tasks
from commd.liveness.bridge_presence import BridgePresence
from commd.process.local_runs import router_of
from schemas.files.findings import did_you_mean
from schemas.mission.access_rules import made_on
from schemas.mission.model import DEFAULT_ROUTER, THIS_MACHINE, Mission, load_mission
from schemas.wire import keys
from schemas.wire.codec import Wire
from schemas.wire.keys import check_name
from schemas.wire.records import Action, ActionStatus, BoardServices, Message, Perception, ServiceRequest
from schemas.wire.term_text import read as parse
from schemas.wire.term_text import write
from schemas.wire.terms import Term, term_of

ROOM = 10_000
"""Changes that may wait for a loop; the oldest are dropped and counted. `present` is always complete."""


class Percepts:
    """The percepts of one agent, kept complete. `async for` yields the present ones, then each change."""

    def __init__(self, bus: Bus, agent: str, robot: str, inject: bool = False) -> None:
        """`inject`: the mission allows percepts by hand."""
        self.dropped = 0
        """Changes that a loop was too slow for."""
        self._loops: list[deque[Perception]] = []
        """The changes that each loop has not read yet."""
        self._changed = asyncio.Event()
        self.perceiving = PerceptSync(bus, agent, robot, self._take, inject)
        self.bridge = BridgePresence(bus, robot, self.perceiving.doubt, self.perceiving.forget)
        self._tasks = Tasks(f"perceiving for {agent}")
        for work in (self.perceiving.run(), self.bridge.run()):
            self._tasks.spawn(work)

    def present(self) -> list[Perception]:
        """Return the present percepts."""
        return self.perceiving.present()

    def of(self, name: str) -> list[tuple[Term, ...]]:
        """Return the parameters of each present percept of a name."""
        return [one.parameters for one in self.perceiving.named(name)]

    async def until(self, condition: Callable[[Percepts], bool], patience: float) -> bool:
        """Wait until `condition(self)` holds, at most `patience` wall seconds. Returns whether it does."""
        try:
            async with asyncio.timeout(patience):
                while not condition(self):
                    await self._changed.wait()
        except TimeoutError:
            return False
        return True

    async def __aiter__(self) -> AsyncIterator[Perception]:
        changes = deque(self.present())
        self._loops.append(changes)
        try:
            while True:
                while not changes:
                    await self._changed.wait()
                yield changes.popleft()
        finally:
            self._loops = [other for other in self._loops if other is not changes]

    def close(self) -> None:
        """End it."""
        self._tasks.cancel()

    def _take(self, change: Perception) -> None:
        for changes in self._loops:
            if len(changes) >= ROOM:
                changes.popleft()
                self.dropped += 1
            changes.append(change)
        changed, self._changed = self._changed, asyncio.Event()
        changed.set()


__all__ = [
    "Client",
    "MailboxFull",
    "NotJoined",
    "NotSendable",
    "NotSent",
    "SendTimeout",
    "TooLarge",
    "Unanswered",
    "UnknownReceiver",
    "join",
    "parse",
    "write",
]

PATIENCE = 10.0
"""Default timeout for the router, for `commd` and for each of its answers, in wall seconds."""
RETRY = 0.2


class NotJoined(ConnectionError):
    """The program is not a member of the team; the text says why."""


class Unanswered(TimeoutError):
    """A question without an answer in time."""


class Client:
    """A member of the team. Made by `join`."""

    def __init__(
        self,
        bus: Bus,
        name: str,
        board: str,
        robots: dict[str, str],
        clock: Clock,
        numbers: Path | None,
        patience: float,
        inject: bool = False,
    ) -> None:
        self.name, self.board = name, board
        self._bus, self._robots, self._clock, self._patience, self._inject = bus, robots, clock, patience, inject
        self._sending = Sending(bus, name)
        self._inbox = ProgramInbox(bus, name, numbers)
        self._percepts: dict[str, Percepts] = {}
        self._action_requests: ActionRequests | None = None
        self._actions = self._questions = 0

    @property
    def speed(self) -> float:
        """Mission seconds that pass in one wall second."""
        return self._clock.speed

    def wall(self, mission_seconds: float) -> float:
        """Return the wall seconds of a span of mission seconds; all timeouts of a client are wall seconds."""
        return self._clock.to_wall(mission_seconds)

    async def sleep(self, mission_seconds: float) -> None:
        """Sleep for a span of mission seconds."""
        await self._clock.sleep(mission_seconds)

    async def send(
        self,
        receiver: str,
        performative: str,
        content: Any,
        *,
        ttl: float | None = None,
        in_reply_to: str = "",
        patience: float | None = None,
    ) -> Message:
        """Send a message; it is on the board's disk when this returns. `content` is a Python value or a term.

        It is not delivered after `ttl` wall seconds. Raises UnknownReceiver, TooLarge, NotSendable, MailboxFull or
        SendTimeout (after `patience` wall seconds), which are all NotSent, and TypeError for a value that cannot be a
        term.
        """
        waits = self._patience if patience is None else patience
        return await self._sending.send(receiver, performative, content, ttl, in_reply_to, waits)

    async def send_again(self, error: SendTimeout) -> None:
        """Send the message that had no answer again, with its number, so that it is delivered once."""
        await self._sending.send_again(error.message, self._patience)

    async def ask(self, receiver: str, content: Any, *, patience: float | None = None) -> Term:
        """Ask somebody something, as `.send(Receiver, askOne, Content, Answer)` does, and return the answer.

        The answer does not appear in `messages`. An agent answers with a belief or with what its plan finds, or with
        False. Raises Unanswered after `patience` wall seconds, and what `send` raises. A later answer is dropped.
        """
        waits = self._patience if patience is None else patience
        until = asyncio.get_running_loop().time() + waits
        self._questions += 1
        question = f"{QUESTION}{self._questions}.{self.name}.{self._bus.boot}"
        with self._inbox.answer_to(question) as answer:
            try:
                await self._sending.send(receiver, "askOne", content, None, "", waits, question, until)
            except SendTimeout:
                if not answer.done():  # else the message was taken
                    raise
            try:
                async with asyncio.timeout_at(until):
                    return (await answer).content
            except TimeoutError:
                undone = self._inbox.undone
                behind = f"; it may be behind {undone} messages that are not done with" if undone else ""
                asked = f"{write(term_of(content))} to {receiver}"
                raise Unanswered(f"{asked}: no answer within {waits:g} s{behind}") from None

    def messages(self) -> Messages:
        """Iterate with `async for` over the messages that the program is not done with, oldest first, then over new
        ones.

        Asking for the next message, or `done`, says that the program is done with the previous one. The message at
        which a loop was left comes again, in the next loop or the next process.
        """
        return self._inbox.read()

    def done(self, message: Message) -> None:
        """Say that the program is done with the present message: it does not come again."""
        self._inbox.finish(message)

    def percepts(self, agent: str | None = None, robot: str | None = None) -> Percepts:
        """Return the percepts of an agent (this client by default). Without a mission name its robot."""
        agent = self.name if agent is None else agent
        robot = self._robots.get(agent) if robot is None else robot
        if robot is None:
            raise ValueError(f"`{agent}` has no robot in the mission: percepts(agent, robot=...)")
        if agent not in self._percepts:
            self._percepts[agent] = Percepts(self._bus, agent, robot, self._inject)
        return self._percepts[agent]

    async def perform(
        self, action: str, *parameters: Any, on_status: Callable[[ActionStatus], None] | None = None
    ) -> ActionStatus:
        """Let this client's robot act. Returns the final status, `succeeded` or not; never raises for a failure.

        `on_status` is called with each status before the final one. Cancelling this coroutine cancels the action.
        """
        percepts = self.percepts()
        if self._action_requests is None:
            self._action_requests = ActionRequests(
                self._bus, self.name, percepts.perceiving, percepts.bridge, self._clock.to_wall
            )
        self._actions += 1
        request = Action(
            id=f"{self.name}:{self._bus.boot}:{self._actions}",
            agent=self.name,
            name=action,
            parameters=tuple(map(term_of, parameters)),
        )
        try:
            return await self._action_requests.perform(request, on_status=on_status)
        except asyncio.CancelledError:
            await asyncio.shield(self._action_requests.cancel(request.id))
            raise

    async def there(self, name: str) -> bool:
        """Return whether an agent, a program or a daemon of that name is alive and within reach.

        False while the own router is away. Raises ValueError for an invalid name.
        """
        check_name(name)
        return bool(await self._bus.tokens(keys.alive(self._bus.fleet, name, "*", "*")))

    async def register(self, service: str) -> None:
        """Offer a service: the other agents find it by `.df_search`."""
        await self.ask_directory("register", service)

    async def deregister(self, service: str) -> None:
        """Withdraw a service."""
        await self.ask_directory("deregister", service)

    async def search(self, service: str) -> tuple[str, ...]:
        """Return who offers a service, on any board."""
        return (await self.ask_directory("search", service)).found

    async def subscribe(self, service: str) -> tuple[str, ...]:
        """As `search`; later providers are reported by mail from `df`: `provider(Agent, "Service")`."""
        return (await self.ask_directory("subscribe", service)).found

    async def ask_directory(self, do: Any, service: str = "", stays: bool = False) -> BoardServices:
        """Ask the board's directory. Raises NotJoined if it does not answer in time, or refuses."""
        key, request = (
            keys.service_requests(self._bus.fleet, self.board, self.name),
            ServiceRequest(agent=self.name, do=do, service=service, stays=stays),
        )
        until = asyncio.get_running_loop().time() + self._patience
        while True:
            try:
                answer = await self._bus.ask_one(key, request, BoardServices, self._patience)
            except BusError as error:
                reason = f"commd of board `{self.board}`, fleet `{self._bus.fleet}`: {error}"
            else:
                if answer.problem:
                    raise NotJoined(f"{do} {service or self.name}: {answer.problem}")
                return answer
            if asyncio.get_running_loop().time() + RETRY >= until:
                raise NotJoined(f"{do}: {reason} ({self._patience:g} s)")
            await asyncio.sleep(RETRY)

    async def close(self) -> None:
        """Acknowledge the mail that is done with, and end the percepts."""
        for percepts in self._percepts.values():
            percepts.close()
        await self._inbox.close()


@asynccontextmanager
async def join(
    name: str,
    *,
    mission: str | Path | Mission | None = None,
    fleet: str = "",
    board: str = "",
    router: str = "",
    wire: Wire = "json",
    robot: str | None = None,
    numbers: str | Path | None = None,
    stays: bool = False,
    speed: float | None = None,
    patience: float = PATIENCE,
) -> AsyncIterator[Client]:
    """Join the team until the end of the block, by a mission file or by fleet, board and router.

    A name that is not in the mission leaves at the end; with `stays`, or if the block fails, its mailbox remains, and
    mail waits for its return. `numbers` is a file that keeps the numbers of the messages that are done with across
    processes. `speed` is that of the run (above 0, up to 100), if it is not the mission's; `patience` is in wall
    seconds, for the router, for `commd` and for each of its answers. Raises NotJoined, AlreadyRunning if the name is
    taken, and Findings for a bad mission.
    """
    check_name(name)
    if speed is not None and not 0 < speed <= 100:
        raise NotJoined(f"speed: expected more than 0 and at most 100, got {speed:g}")
    declared = load_mission(mission) if isinstance(mission, str | Path) else mission
    robots, known = dict[str, str](), False
    if declared is not None:
        if name in declared.agents:
            raise NotJoined(f"`{name}` is an agent of the mission: a client needs a name of its own")
        known = name in declared.clients
        robots = {agent: robot for robot in declared.robots for agent in declared.agents_of(robot)}
        fleet, wire, speed = fleet or declared.fleet, declared.wire, declared.speed if speed is None else speed
        board = board or declared.mailboxes.get(name) or next(iter(declared.boards), THIS_MACHINE)
        if board not in (declared.boards or {THIS_MACHINE}):
            raise NotJoined(f"no board `{board}`{did_you_mean(board, declared.boards)}")
    if robot is not None:
        robots[name] = robot
    check_name(fleet)
    if declared is not None and declared.names_router:
        router = router or declared.router.endpoint
    router = router or await router_of(fleet, DEFAULT_ROUTER)
    clock = Clock(1.0 if speed is None else speed)
    file = None if numbers is None else Path(numbers)
    async with _bus(router, fleet, name, clock, wire, patience) as bus:
        try:
            await _claim(bus, name)
        except AccessDenied as denied:
            hint = "" if known else f"; a name that is not in its mission must begin with `{made_on(board)}` there"
            raise NotJoined(f"{denied}{hint}") from None
        inject = declared is not None and declared.inject
        client = Client(bus, name, board or THIS_MACHINE, robots, clock, file, patience, inject)
        try:
            if not known:
                await client.ask_directory("join", stays=stays)
            await bus.permitted()
            yield client
            if not known and not stays:
                await client.ask_directory("leave")
        finally:
            await client.close()


@asynccontextmanager
async def _bus(endpoint: str, fleet: str, name: str, clock: Clock, wire: Wire, patience: float) -> AsyncIterator[Bus]:
    try:
        async with open_bus(endpoint, fleet=fleet, name=name, daemon="client", wire=wire, patience=patience) as bus:
            yield bus
    except BusClosed as closed:
        raise NotJoined(str(closed)) from None


async def _claim(bus: Bus, name: str) -> None:
    """Declare the presence of a client. Raises AlreadyRunning if anybody has its name."""
    for key in await bus.tokens(keys.alive(bus.fleet, name, "*", "*")):
        daemon = key.split("/")[-2]
        if daemon != bus.daemon:
            raise AlreadyRunning(f"`{name}` of fleet `{bus.fleet}` is taken: {daemon} serves it")
    await bus.claim(name)
