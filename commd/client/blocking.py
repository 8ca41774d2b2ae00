"""Join a team from a program without an event loop: each call blocks until it is done.

    with join("planner", mission="survey.yaml") as me:
        me.send("scout", "achieve", parse("survey(north)"))
        for message in me.messages(within=60):
            print(message.sender, write(message.content))

The client runs in a thread of its own; use it from one thread.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

from commd.client import client
from commd.client.receive_mail import Messages
from schemas.wire.records import ActionStatus, Message, Perception
from schemas.wire.terms import Term

T = TypeVar("T")


class BlockingClient:
    """A member of the team. Made by `join`; each method is that of `commd.client.Client` and raises what it raises."""

    def __init__(self, member: client.Client, loop: asyncio.AbstractEventLoop) -> None:
        self.member = member
        self._loop = loop

    def send(self, receiver: str, performative: str, content: Any, **how: Any) -> Message:
        """Send a message; it is on the board's disk when this returns."""
        return self._wait(self.member.send(receiver, performative, content, **how))

    def ask(self, receiver: str, content: Any, **how: Any) -> Term:
        """Ask a question and return the answer."""
        return self._wait(self.member.ask(receiver, content, **how))

    def send_again(self, error: client.SendTimeout) -> None:
        """Send the message that had no answer again, with its number."""
        self._wait(self.member.send_again(error))

    def messages(self, within: float | None = None) -> Iterator[Message]:
        """Iterate over the messages that are not done with, then new ones; ends after `within` wall seconds without
        any."""

        async def begin() -> Messages:
            return self.member.messages()

        reading = self._wait(begin())
        while True:
            try:
                yield self._wait(asyncio.wait_for(anext(reading), within))
            except TimeoutError:
                return

    def done(self, message: Message) -> None:
        """Say that the program is done with the present message."""

        async def done() -> None:
            self.member.done(message)

        self._wait(done())

    def present(self, agent: str | None = None, *, within: float = client.PATIENCE) -> list[Perception]:
        """Return the present percepts of an agent; while there are none, wait at most `within` wall seconds."""

        async def look() -> list[Perception]:
            percepts = self.member.percepts(agent)
            await percepts.until(lambda seen: bool(seen.present()), within)
            return percepts.present()

        return self._wait(look())

    def there(self, name: str) -> bool:
        """Return whether somebody of that name is alive and within reach."""
        return self._wait(self.member.there(name))

    def perform(
        self, action: str, *parameters: Any, on_status: Callable[[ActionStatus], None] | None = None
    ) -> ActionStatus:
        """Let this client's robot act. `on_status` is called in the client's thread."""
        return self._wait(self.member.perform(action, *parameters, on_status=on_status))

    def register(self, service: str) -> None:
        """Offer a service."""
        self._wait(self.member.register(service))

    def search(self, service: str) -> tuple[str, ...]:
        """Return the providers of a service on all boards."""
        return self._wait(self.member.search(service))

    def _wait(self, work: Coroutine[Any, Any, T]) -> T:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result()


@contextmanager
def join(name: str, **how: Any) -> Iterator[BlockingClient]:
    """Join the team until the end of the block; arguments and errors are those of `commd.client.join`."""
    joined: Future[tuple[BlockingClient, asyncio.Future[None]]] = Future()

    async def live() -> None:
        try:
            async with client.join(name, **how) as member:
                loop = asyncio.get_running_loop()
                leaving = loop.create_future()
                joined.set_result((BlockingClient(member, loop), leaving))
                await leaving
        except _Failed:
            return
        except Exception as error:
            if joined.done():
                raise
            joined.set_exception(error)

    with ThreadPoolExecutor(1, thread_name_prefix=name) as thread:
        life = thread.submit(asyncio.run, live())
        me, leaving = joined.result()
        try:
            yield me
        except BaseException:
            me._loop.call_soon_threadsafe(leaving.set_exception, _Failed())
            raise
        else:
            me._loop.call_soon_threadsafe(leaving.set_result, None)
        finally:
            life.result()


class _Failed(Exception):
    """The block has failed: the client ends as one that dies does."""
