"""An event loop in virtual time: it never waits, it advances its clock to the next timer. UDP stays in the process.

Equal times run in the order in which their timers were set: the order of asyncio's heap depends on what else waits.
"""

from __future__ import annotations

import asyncio
import heapq
import selectors
import socket
from asyncio import events
from collections.abc import Callable
from contextvars import Context, copy_context
from itertools import count
from typing import Any, Final

CLOCK_RESOLUTION: Final = 1e-9
"""Seconds by which timers may be early: with asyncio's own, a timer of virtual time could run before its time."""
FIRST_PORT: Final = 40_000
"""Port of the first socket that asks for none in particular."""


WIRE: Final = copy_context()
"""Of what is under way: it arrives although its sender has died."""


class Deadlock(RuntimeError):
    """No task can go on and no timer is set: nothing would ever happen again."""


class _Timer(events.TimerHandle):
    __slots__ = ("number", "runs")

    number: int
    runs: Callable[[Context], bool]

    def _run(self) -> None:
        if self.runs(self._context):  # type: ignore[attr-defined]
            super()._run()

    def __lt__(self, other: object) -> bool:
        if not isinstance(other, _Timer):
            return NotImplemented
        return (self._when, self.number) < (other._when, other.number)  # type: ignore[attr-defined]


class _Handle(events.Handle):
    __slots__ = ("runs",)

    runs: Callable[[Context], bool]

    def _run(self) -> None:
        if self.runs(self._context):  # type: ignore[attr-defined]
            super()._run()


class _Selector(selectors.BaseSelector):
    """Advances the clock where a selector would wait; files are not watched."""

    def __init__(self, advance: Callable[[float | None], None]) -> None:
        self._advance = advance

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        return selectors.SelectorKey(fileobj, -1, events, data)

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        return selectors.SelectorKey(fileobj, -1, 0, None)

    def modify(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        return self.register(fileobj, events, data)

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        self._advance(timeout)
        return []

    def get_map(self) -> Any:
        return {}

    def get_key(self, fileobj: Any) -> selectors.SelectorKey:
        raise KeyError(fileobj)


class VirtualLoop(asyncio.SelectorEventLoop):
    """Runs everything of a trial in one thread; `time()` is in virtual seconds since the start."""

    def __init__(self) -> None:
        self._now = 0.0
        super().__init__(_Selector(self._advance))
        self._clock_resolution = CLOCK_RESOLUTION
        self._numbers = count()
        self._udp: dict[tuple[str, int], Datagrams] = {}
        self._ports = count(FIRST_PORT)
        self.delay: Callable[[tuple[str, int], tuple[str, int]], float | None] = lambda sender, receiver: 0.0005
        """Virtual seconds that a datagram takes; None: it is lost."""

        self.runs: Callable[[Context], bool] = lambda context: True
        """Whether what was begun in a context still runs: nothing of a process that is dead does."""
        self.opened: Callable[[Datagrams], None] = lambda transport: None
        """Called with each socket that is opened."""
        self.handlers: Callable[[], dict[int, Callable[[], object]]] = dict
        """Return the signal handlers of the present process."""

    def time(self) -> float:
        """Return virtual seconds since the start."""
        return self._now

    def _advance(self, seconds: float | None) -> None:
        if seconds is None:
            raise Deadlock(f"at {self._now:.3f} s of virtual time everything waits, and no timer is set")
        self._now += max(0.0, seconds)

    def call_at(  # type: ignore[override]
        self, when: float, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.TimerHandle:
        """Call at a virtual time; calls for one time in the order in which they were asked for."""
        timer = _Timer(when, callback, args, self, context)
        timer.number, timer.runs = next(self._numbers), self.runs
        heapq.heappush(self._scheduled, timer)  # type: ignore[attr-defined]
        timer._scheduled = True  # type: ignore[attr-defined]
        return timer

    def call_soon(  # type: ignore[override]
        self, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.Handle:
        """Call in the next pass."""
        handle = _Handle(callback, args, self, context)
        handle.runs = self.runs
        self._ready.append(handle)  # type: ignore[attr-defined]
        return handle

    def call_soon_threadsafe(  # type: ignore[override]
        self, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.Handle:
        """Call soon; there are no other threads."""
        return self.call_soon(callback, *args, context=context)

    def run_in_executor(  # type: ignore[override]
        self, executor: Any, func: Callable[..., Any], *args: Any
    ) -> asyncio.Future[Any]:
        """Call a function in this thread, in a later pass of the loop."""
        done: asyncio.Future[Any] = self.create_future()

        def work() -> None:
            if done.cancelled():
                return
            try:
                done.set_result(func(*args))
            except Exception as error:
                done.set_exception(error)

        self.call_soon(work)
        return done

    def add_signal_handler(  # type: ignore[override]
        self, sig: int, callback: Callable[..., object], *args: Any
    ) -> None:
        """Let the present process handle a signal."""
        self.handlers()[sig] = lambda: callback(*args)

    def remove_signal_handler(self, sig: int) -> bool:
        """Let it end the present process again."""
        return self.handlers().pop(sig, None) is not None

    async def getaddrinfo(self, host: Any, port: Any, **_: Any) -> Any:
        """Return the address as it was given."""
        return [(socket.AF_INET, socket.SOCK_DGRAM, 0, "", (host, port))]

    async def create_datagram_endpoint(
        self, protocol_factory: Callable[[], Any], local_addr: Any = None, remote_addr: Any = None, **_: Any
    ) -> tuple[Any, Any]:
        """Open a UDP socket in this process. Raises OSError if the address is taken."""
        local = tuple(local_addr) if local_addr is not None else ("127.0.0.1", next(self._ports))
        if local in self._udp:
            raise OSError(98, "Address already in use")
        protocol = protocol_factory()
        remote = None if remote_addr is None else tuple(remote_addr)
        transport = self._udp[local] = Datagrams(self, local, remote, protocol)
        self.opened(transport)
        protocol.connection_made(transport)
        return transport, protocol


class Datagrams(asyncio.DatagramTransport):
    """A UDP socket of the virtual network."""

    def __init__(
        self, loop: VirtualLoop, local: tuple[str, int], remote: tuple[str, int] | None, protocol: Any
    ) -> None:
        super().__init__()
        self._loop, self._local, self._remote, self._protocol = loop, local, remote, protocol
        self._closed = False
        self._context = copy_context()

    def sendto(self, data: Any, addr: Any = None) -> None:
        receiver = self._remote if addr is None else tuple(addr)
        assert receiver is not None
        delay = self._loop.delay(self._local, receiver)
        if delay is not None and not self._closed:
            self._loop.call_at(self._loop.time() + delay, self._deliver, bytes(data), receiver, context=WIRE)

    def _deliver(self, data: bytes, receiver: tuple[str, int]) -> None:
        other = self._loop._udp.get(receiver)
        if other is None:
            if not self._closed and self._remote is not None and self._loop.runs(self._context):
                self._protocol.error_received(ConnectionRefusedError(111, "Connection refused"))
            return
        if other._remote is None or other._remote == self._local:
            other._context.copy().run(other._protocol.datagram_received, data, self._local)

    def is_closing(self) -> bool:
        return self._closed

    def get_protocol(self) -> Any:
        return self._protocol

    def get_write_buffer_size(self) -> int:
        return 0

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        return {"sockname": self._local, "peername": self._remote, "socket": _Options()}.get(name, default)

    def free(self) -> None:
        """Give its address free."""
        if not self._closed:
            self._closed = True
            del self._loop._udp[self._local]

    def close(self) -> None:
        if not self._closed:
            self.free()
            self._loop.call_soon(self._protocol.connection_lost, None)

    abort = close


class _Options:
    def setsockopt(self, *_: Any) -> None:
        """Ignore it."""
