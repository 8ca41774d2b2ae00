"""An event loop in virtual time: it never waits, it advances its clock to the next timer. UDP stays in the process.

Equal times run in the order in which their timers were set: the order of asyncio's heap depends on what else waits.
"""

from __future__ import annotations

import asyncio
import socket
from collections import deque
from collections.abc import Callable
from contextvars import Context, ContextVar, copy_context
from heapq import heappop, heappush
from itertools import count
from typing import Any, Final

CLOCK_RESOLUTION: Final = 1e-9
"""Seconds by which timers may be early: times that differ by less are one."""
MOST_PASSES: Final = 10_000
"""Passes at one time, after which the clock advances by its resolution: a real clock advances with each."""
FIRST_PORT: Final = 40_000
"""Port of the first socket that asks for none in particular."""


WIRE: Final = copy_context()
"""Of what is under way: it arrives although its sender has died."""


class Deadlock(RuntimeError):
    """No task can go on and no timer is set: nothing would ever happen again."""


class _Call:
    """A call that is to be made: what asyncio's handles are, with less to set and to ask at each."""

    __slots__ = ("_when", "args", "callback", "context")

    def __init__(self, when: float, callback: Callable[..., object], args: Any, context: Context | None) -> None:
        self._when, self.args = when, args
        self.callback: Callable[..., object] | None = callback
        """None: it is cancelled."""
        self.context = copy_context() if context is None else context

    def cancel(self) -> None:
        """Do not make it."""
        self.callback = self.args = None

    def cancelled(self) -> bool:
        """Return whether it is not made."""
        return self.callback is None

    def when(self) -> float:
        """Return its virtual time."""
        return self._when


class VirtualLoop(asyncio.BaseEventLoop):
    """Runs everything of a trial in one thread; `time()` is in virtual seconds since the start."""

    def __init__(self) -> None:
        self._now = 0.0
        self._passes = 0
        """Passes since the clock advanced to a timer."""
        super().__init__()
        self._timers: list[tuple[float, int, _Call]] = []
        """With their times and numbers, as a heap."""
        self._numbers = count()
        self._udp: dict[tuple[str, int], Datagrams] = {}
        self._ports = count(FIRST_PORT)
        self.delay: Callable[[tuple[str, int], tuple[str, int]], float | None] = lambda sender, receiver: 0.0005
        """Virtual seconds that a datagram takes; None: it is lost."""

        self.owner: ContextVar[Any] = ContextVar("owner", default=None)
        """The process that runs now, with its `sockets` and `handlers` of signals; nothing of one that is `dead` runs.
        None: no process."""

    def time(self) -> float:
        """Return virtual seconds since the start."""
        return self._now

    def _run_once(self) -> None:
        """Advance the clock to the next timer if nothing else is to be done, and make the calls that are due."""
        ready: deque[_Call] = self._ready  # type: ignore[attr-defined]
        timers, owner = self._timers, self.owner
        if not ready and not self._stopping:  # type: ignore[attr-defined]
            while timers and timers[0][2].callback is None:
                heappop(timers)
            if not timers:
                raise Deadlock(f"at {self._now:.3f} s of virtual time everything waits, and no timer is set")
            # Who waits by a clock of its own, which differs from that of the loop by rounding, sets a timer for the
            # present time again until that clock says that it is due: for ever in a time that stood still.
            self._now = due if (due := timers[0][0]) > self._now else self._now + CLOCK_RESOLUTION
            self._passes = 0
        elif (passes := self._passes) < MOST_PASSES:
            self._passes = passes + 1
        else:  # `asyncio.timeout` sets no timer if rounding makes its end the present time
            self._now, self._passes = self._now + CLOCK_RESOLUTION, 0
        while timers and (due := timers[0][0]) < self._now + CLOCK_RESOLUTION:
            if due > self._now:  # none runs before its time
                self._now = due
            if (call := heappop(timers)[2]).callback is not None:
                ready.append(call)
        for _ in range(len(ready)):
            call = ready.popleft()
            if (callback := call.callback) is None or ((of := call.context.get(owner)) is not None and of.dead):
                continue
            try:
                call.context.run(callback, *call.args)
            except (SystemExit, KeyboardInterrupt):
                raise
            except BaseException as error:
                self.call_exception_handler({"message": f"in {callback!r}", "exception": error})

    def call_at(  # type: ignore[override]
        self, when: float, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.TimerHandle:
        """Call at a virtual time; calls for one time in the order in which they were asked for."""
        call = _Call(when, callback, args, context)
        heappush(self._timers, (when, next(self._numbers), call))
        return call  # type: ignore[return-value]

    def call_later(  # type: ignore[override]
        self, delay: float, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.TimerHandle:
        """Call after virtual seconds."""
        return self.call_at(self._now + delay, callback, *args, context=context)

    def call_soon(  # type: ignore[override]
        self, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.Handle:
        """Call in the next pass."""
        call = _Call(self._now, callback, args, context)
        self._ready.append(call)  # type: ignore[attr-defined]
        return call  # type: ignore[return-value]

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
        if (process := self.owner.get()) is not None:
            process.handlers[sig] = lambda: callback(*args)

    def remove_signal_handler(self, sig: int) -> bool:
        """Let it end the present process again."""
        return (process := self.owner.get()) is not None and process.handlers.pop(sig, None) is not None

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
        if (process := self.owner.get()) is not None:
            process.sockets.append(transport)
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
        self._owner = loop.owner.get()

    def sendto(self, data: Any, addr: Any = None) -> None:
        """Let a datagram arrive after the delay of its way, unless the way loses it."""
        receiver = self._remote if addr is None else tuple(addr)
        assert receiver is not None
        delay = self._loop.delay(self._local, receiver)
        if delay is not None and not self._closed:
            self._loop.call_at(self._loop.time() + delay, self._deliver, bytes(data), receiver, context=WIRE)

    def _deliver(self, data: bytes, receiver: tuple[str, int]) -> None:
        other = self._loop._udp.get(receiver)
        if other is None:
            if not self._closed and self._remote is not None and (self._owner is None or not self._owner.dead):
                self._protocol.error_received(ConnectionRefusedError(111, "Connection refused"))
            return
        if other._remote is None or other._remote == self._local:
            other._context.copy().run(other._protocol.datagram_received, data, self._local)

    def is_closing(self) -> bool:
        """Whether it is closed."""
        return self._closed

    def get_protocol(self) -> Any:
        """Return what receives its datagrams."""
        return self._protocol

    def get_write_buffer_size(self) -> int:
        """Return 0 bytes: nothing waits."""
        return 0

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        """Return the address of this or the other end, or a socket that knows nothing."""
        return {"sockname": self._local, "peername": self._remote, "socket": _Socket()}.get(name, default)

    def free(self) -> None:
        """Give its address free."""
        if not self._closed:
            self._closed = True
            del self._loop._udp[self._local]

    def close(self) -> None:
        """Give its address free, and tell the protocol."""
        if not self._closed:
            self.free()
            self._loop.call_soon(self._protocol.connection_lost, None)

    abort = close


class _Socket:
    """The socket below a transport: nothing waits in it, as each datagram is handed over when it arrives."""

    def setsockopt(self, *_: Any) -> None:
        """Ignore it."""

    def dup(self) -> _Socket:
        """Return the same socket."""
        return self

    def recvfrom(self, size: int) -> tuple[bytes, Any]:
        """Raise BlockingIOError."""
        raise BlockingIOError

    def close(self) -> None:
        """Do nothing."""
