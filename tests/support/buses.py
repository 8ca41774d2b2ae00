"""Real Zenoh sessions for tests: a router and clients in one process, closed at the end whatever happens."""

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Iterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, closing, contextmanager
from inspect import Parameter, Signature, signature
from typing import Any, Literal, Protocol, cast

import pytest

from argosy.trial.edges import bus_edges
from argosy.trial.event_loop import VirtualLoop
from argosy.trial.network import Network
from commd.bus.bus import Bus, open_bus

FLEET = "test"
PATIENCE = 90.0
"""Wall seconds for anything that a test waits for: what passes takes none of them, a busy machine may need many."""


class Connect(Protocol):
    """Opens one more session on the bus of a test; a client has seen its router then."""

    def __call__(
        self, name: str = "x", daemon: str = "agentd", mode: Literal["client", "router"] = "client"
    ) -> Awaitable[Bus]: ...


@asynccontextmanager
async def with_a_router(endpoint: str, seconds: float) -> AsyncIterator[Connect]:
    """Yield what opens sessions, with a router at `endpoint`, bounded in seconds of the loop."""
    async with AsyncExitStack() as stack, asyncio.timeout(seconds):

        async def connect(name: str = "x", daemon: str = "agentd", mode: Literal["client", "router"] = "client") -> Bus:
            bus = await stack.enter_async_context(open_bus(endpoint, fleet=FLEET, name=name, daemon=daemon, mode=mode))
            await until(lambda: bus.router_up, f"{daemon} {name} sees the router")
            return bus

        await connect("board", "commd", "router")
        yield connect


async def _on_a_bus(endpoint: str, body: Callable[[Connect], Coroutine[Any, Any, None]], seconds: float) -> None:
    async with with_a_router(endpoint, seconds) as connect:
        await body(connect)


def on_a_bus(endpoint: str, body: Callable[[Connect], Coroutine[Any, Any, None]], seconds: float = 240) -> None:
    """Run `body(connect)` with a router at `endpoint`, bounded in wall seconds."""
    asyncio.run(_on_a_bus(endpoint, body, seconds))


VIRTUAL_ENDPOINT = "tcp/127.0.0.1:7447"
"""Of the router of a virtual network."""


@contextmanager
def on_the_virtual_network() -> Iterator[tuple[asyncio.Runner, Network]]:
    """Yield what runs coroutines in virtual time, and the network of trials, to which they open their sessions."""
    with asyncio.Runner(loop_factory=VirtualLoop) as runner, pytest.MonkeyPatch.context() as patch:
        loop = cast(VirtualLoop, runner.get_loop())
        network = Network(loop)
        for name, replacement in bus_edges(network).items():
            patch.setattr(name, replacement)
        patch.setattr(time, "monotonic", loop.time)
        yield runner, network


def on_a_virtual_bus(body: Callable[[Connect], Coroutine[Any, Any, None]]) -> None:
    """Run `body(connect)` with a router on the virtual network, bounded in virtual seconds."""
    with on_the_virtual_network() as (runner, _):
        runner.run(_on_a_bus(VIRTUAL_ENDPOINT, body, 3600))


Test = Callable[..., Coroutine[Any, Any, None]]


def run_by(run: Callable[..., None], *given: str, needs: Sequence[str] = ()) -> Callable[[Test], Callable[..., None]]:
    """Make a decorator of async tests from `run(body, fixture...)`, which calls `body(given...)` in an event loop.

    The parameters `given` of a test come from `run`, which itself needs the fixtures `needs`; all others are fixtures.
    """

    def decorate(test: Test) -> Callable[..., None]:
        own = [one.name for one in signature(test).parameters.values() if one.name not in given]

        def called(**values: Any) -> None:
            fixtures = {name: values[name] for name in own}
            run(
                lambda *made: test(**dict(zip(given, made, strict=True)), **fixtures), *(values[name] for name in needs)
            )

        called.__name__, called.__doc__, called.__module__ = test.__name__, test.__doc__, test.__module__
        names = dict.fromkeys((*needs, *own))
        called.__signature__ = Signature(  # type: ignore[attr-defined]
            [Parameter(name, Parameter.POSITIONAL_OR_KEYWORD) for name in names]
        )
        return called

    return decorate


def in_a_loop(body: Test) -> None:
    """Run `body()` in an event loop of its own, bounded in wall seconds."""
    asyncio.run(asyncio.wait_for(body(), 240))


def in_virtual_time(body: Test) -> None:
    """Run `body()` in an event loop that never waits: its clock goes to the next timer, and is `time.monotonic`."""
    loop = VirtualLoop()
    with pytest.MonkeyPatch.context() as patch, closing(loop):
        patch.setattr(time, "monotonic", loop.time)
        loop.run_until_complete(body())


virtual_test = run_by(in_virtual_time)
"""Runs an async test in virtual time; its parameters are fixtures."""
virtual_bus_test = run_by(on_a_virtual_bus, "connect")
"""Gives an async test `connect` on the virtual network, in virtual time: for what waits or is asked again."""


@asynccontextmanager
async def session(
    endpoint: str,
    name: str,
    daemon: str = "agentd",
    *,
    router: bool = False,
    listen: Sequence[str] = (),
    connect: Sequence[str] = (),
) -> AsyncIterator[Bus]:
    """A session of its own, for tests with several routers; a client has seen its router then."""
    mode: Literal["client", "router"] = "router" if router else "client"
    async with open_bus(
        endpoint, fleet=FLEET, name=name, daemon=daemon, mode=mode, listen=listen, connect=connect
    ) as bus:
        await until(lambda: bus.router_up, f"{daemon} {name} sees the router")
        yield bus


@asynccontextmanager
async def under_way(work: Coroutine[Any, Any, None]) -> AsyncIterator[None]:
    """Run what has no end until the block ends; it has begun when the block does."""
    task = asyncio.create_task(work)
    await asyncio.sleep(0)
    try:
        yield
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def subscribed(bus: Bus, key: str) -> None:
    """Wait until what `bus` puts on `key` reaches a subscriber: declarations take their time on a busy machine."""
    publisher = bus._session.declare_publisher(key)
    await until(lambda: publisher.matching_status.matching, f"somebody subscribes to {key}")
    publisher.undeclare()


async def served(bus: Bus, key: str, wanted: bool = True) -> None:
    """Wait until `bus` knows of somebody who serves `key`, or that nobody does. Behind a second router a query may not
    reach it for 0.1 s more, in which that router has no route yet."""
    querier = bus._session.declare_querier(key)
    await until(lambda: bool(querier.matching_status.matching) == wanted, f"somebody serves {key}: {wanted}")
    querier.undeclare()


async def arrived(*buses: Bus) -> None:
    """Wait until what these sessions have sent by now, one after the other, has gone through their router."""
    for bus in buses:
        assert await bus.round_trip(PATIENCE)


async def until(
    condition: Callable[[], object] | Callable[[], Awaitable[object]], wish: str, seconds: float = PATIENCE
) -> None:
    """Wait until `condition()`, or what it is awaited for, is true; fail with the wish after a bound."""
    try:
        async with asyncio.timeout(seconds):
            while not (await found if isinstance(found := condition(), Awaitable) else found):
                await asyncio.sleep(0.01)
    except TimeoutError:
        raise AssertionError(f"not within {seconds:g} s: {wish}") from None


async def ended(task: asyncio.Task[Any], what: str, seconds: float = PATIENCE) -> None:
    """Wait until a task that was told to end has ended; fail after a bound, whatever it still waits for."""
    done, _ = await asyncio.wait([task], timeout=seconds)
    if not done:
        task.cancel()
        raise AssertionError(f"not within {seconds:g} s: {what} ends")
    task.result()
