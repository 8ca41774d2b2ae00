"""One set of scenarios on two networks: a real Zenoh router and its sessions, and the virtual network of a trial."""

import asyncio
import subprocess
import sys
from collections.abc import Callable, Coroutine
from contextlib import AbstractAsyncContextManager, AsyncExitStack
from typing import Any, Literal, TypeVar

from argosy.trial.network import Network
from commd.bus.bus import Bus, open_bus
from tests.argosy.trial import doomed
from tests.support.buses import FLEET, VIRTUAL_ENDPOINT, on_the_virtual_network, until
from tests.support.forked import ROOT

T = TypeVar("T")


class Stage:
    """A network of one kind, with what differs between the two kinds."""

    def __init__(self, endpoint: str, stack: AsyncExitStack) -> None:
        self.endpoint, self._stack = endpoint, stack
        self._router = AsyncExitStack()

    async def open(
        self, name: str = "x", daemon: str = "agentd", mode: Literal["client", "router"] = "client", **options: Any
    ) -> Bus:
        """Open a session, and wait until it sees its router. It closes with the scenario."""
        bus = await self._stack.enter_async_context(self.session(name, daemon, mode, **options))
        await until(lambda: bus.router_up, f"{daemon} {name} sees the router")
        return bus

    def session(
        self, name: str = "x", daemon: str = "agentd", mode: Literal["client", "router"] = "client", **options: Any
    ) -> AbstractAsyncContextManager[Bus]:
        """Return a session that the scenario itself opens and closes."""
        return open_bus(self.endpoint, fleet=FLEET, name=name, daemon=daemon, mode=mode, **options)

    async def start_router(self) -> None:
        await self._router.enter_async_context(self.session("board", "commd", "router"))

    async def stop_router(self) -> None:
        """End the router: its sessions break off."""
        await self._router.aclose()

    async def doomed(self) -> Callable[[], None]:
        """Open a session that serves `tests.argosy.trial.doomed`; return what kills it."""
        raise NotImplementedError


class ZenohStage(Stage):
    """Real sessions; the doomed one is in a process of its own."""

    async def doomed(self) -> Callable[[], None]:
        command = [sys.executable, "-m", doomed.__name__, self.endpoint]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, cwd=ROOT)  # noqa: ASYNC220 (nothing else runs)

        def kill() -> None:
            process.kill()
            process.wait()

        self._stack.callback(kill)
        assert await asyncio.to_thread(process.stdout.readline) == b"ready\n"
        process.stdout.close()
        return kill


class VirtualStage(Stage):
    """Sessions of the virtual network."""

    def __init__(self, endpoint: str, stack: AsyncExitStack, network: Network) -> None:
        super().__init__(endpoint, stack)
        self.network = network

    async def doomed(self) -> Callable[[], None]:
        bus = await self.open("doomed")
        doomed.serve_forever(bus)
        session: Any = bus._session
        return lambda: self.network.close(session)


Scenario = Callable[[Stage], Coroutine[Any, Any, T]]


def on_zenoh(scenario: Scenario[T], endpoint: str) -> T:
    """Return what a scenario finds with a real router at an endpoint."""

    async def play() -> T:
        async with AsyncExitStack() as stack, asyncio.timeout(240):
            return await _play(scenario, ZenohStage(endpoint, stack))

    return asyncio.run(play())


def on_virtual(scenario: Scenario[T]) -> T:
    """Return what it finds on the virtual network."""
    with on_the_virtual_network() as (runner, network):

        async def play() -> T:
            async with AsyncExitStack() as stack, asyncio.timeout(240):
                return await _play(scenario, VirtualStage(VIRTUAL_ENDPOINT, stack, network))

        return runner.run(play())


async def _play(scenario: Scenario[T], stage: Stage) -> T:
    await stage.start_router()
    stage._stack.push_async_callback(stage.stop_router)
    return await scenario(stage)


def same_on_both(expected: object) -> Callable[[Scenario[object]], Callable[..., None]]:
    """Make a test of a scenario: it finds `expected` with real Zenoh and on the virtual network."""

    def decorate(scenario: Scenario[object]) -> Callable[..., None]:
        def test(endpoint: str) -> None:
            zenoh, virtual = on_zenoh(scenario, endpoint), on_virtual(scenario)
            assert zenoh == expected
            assert virtual == expected

        test.__name__, test.__doc__, test.__module__ = scenario.__name__, scenario.__doc__, scenario.__module__
        return test

    return decorate
