"""A link between two routers that can be cut: a TCP relay which, while it is cut, passes nothing and closes nothing."""

import asyncio
from contextlib import suppress
from typing import Self

_READ = 65_536


class Relay:
    """Passes connections on `port` to `target`, both on loopback."""

    def __init__(self, port: int, target: int) -> None:
        self.port, self.target = port, target
        self.cuts = 0
        self.forth = self.back = 0
        """Bytes that came from those who have connected, and from the target."""
        self._open = asyncio.Event()
        self._open.set()
        self._tasks: set[asyncio.Task[None]] = set()
        self._writers: set[asyncio.StreamWriter] = set()

    async def __aenter__(self) -> Self:
        self._server = await asyncio.start_server(self._accept, "127.0.0.1", self.port)
        return self

    async def __aexit__(self, *_: object) -> None:
        self._server.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for writer in self._writers:
            writer.close()

    def cut(self) -> None:
        """Let nothing pass: as a radio link out of range, it says nothing about it."""
        self.cuts += self._open.is_set()
        self._open.clear()

    def reset(self) -> None:
        """End the connections there are, as a reset does; new ones pass."""
        for writer in self._writers:
            writer.transport.abort()
        self._writers.clear()

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.add(writer)
        await self._open.wait()
        try:
            onward, back = await asyncio.open_connection("127.0.0.1", self.target)
        except OSError:  # nobody listens there now
            writer.close()
            return
        self._writers.add(back)
        for source, sink in ((reader, back), (onward, writer)):
            task = asyncio.create_task(self._pass(source, sink, forth=source is reader))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    async def _pass(self, source: asyncio.StreamReader, sink: asyncio.StreamWriter, *, forth: bool) -> None:
        with suppress(OSError):
            while data := await source.read(_READ):
                if forth:
                    self.forth += len(data)
                else:
                    self.back += len(data)
                await self._open.wait()
                sink.write(data)
                await sink.drain()
        await self._open.wait()
        with suppress(OSError):
            sink.close()
