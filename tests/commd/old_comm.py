"""A Comm node as the paper describes it (sections 4.4 and 5.2), and a post office in memory for the gateway's tests."""

import asyncio
import socket
from collections.abc import Callable, Sequence

from commd.mail.delivery import Deliver
from schemas.wire.records import Message, Receipt, Refusal


class OldCommNode:
    """Sends `<id,sender,itlforce,receiver,data>` to a fixed address; reads 1,024 bytes of each datagram, no more."""

    def __init__(self, host: str = "127.0.0.1") -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((host, 0))
        self.socket.setblocking(False)
        self.heard: list[str] = []
        self._reading = asyncio.create_task(self._read())

    @property
    def address(self) -> str:
        host, port = self.socket.getsockname()
        return f"{host}:{port}"

    def send(self, datagram: str | bytes, address: str) -> None:
        host, port = address.split(":")
        payload = datagram if isinstance(datagram, bytes) else datagram.encode()
        self.socket.sendto(payload, (host, int(port)))

    async def _read(self) -> None:
        while True:
            payload = await asyncio.get_running_loop().sock_recv(self.socket, 1024)
            self.heard.append(payload.decode())

    async def close(self) -> None:
        self._reading.cancel()
        await asyncio.gather(self._reading, return_exceptions=True)
        self.socket.close()


class PostOffice:
    """Keeps what it takes, and refuses receivers that it does not know."""

    def __init__(self, *names: str) -> None:
        self.homes = dict.fromkeys(names, "pi1")
        self.taken: list[Message] = []
        self.deliver: dict[str, Deliver] = {}
        self.full: set[str] = set()

    async def take(self, messages: Sequence[Message]) -> Receipt:
        refused, later = dict[int, str](), dict[int, str]()
        for place, message in enumerate(messages):
            if message.receiver not in self.homes:
                refused[place] = Refusal(code="receiver_not_found")
            elif message.receiver in self.full:
                later[place] = Refusal(code="mailbox_full")
            else:
                self.taken.append(message)
        return Receipt(taken=len(messages) - len(refused) - len(later), refused=refused, later=later)

    def attach(self, name: str, deliver: Deliver) -> Callable[[], None]:
        self.deliver[name] = deliver
        return lambda: self.deliver.pop(name) and None
