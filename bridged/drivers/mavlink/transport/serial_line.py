"""A serial line under a MAVLink link, by the terminal interface of the operating system."""

import asyncio
import errno
import os
import termios
import tty

from bridged.drivers.mavlink.transport.endpoint import MAX_QUEUED_BYTES, Connection, Switchboard, in_words
from bridged.drivers.mavlink.transport.link_peers import LinkError

_READ_BYTES = 4096


async def open_serial(link: Switchboard) -> Connection:
    """Opens the device of the link's address. Raises LinkError."""
    line = SerialLine(link)
    return Connection(line.lost, line.close)


class SerialLine:
    """A serial device in raw mode: 8 data bits, no parity, 1 stop bit, no flow control."""

    def __init__(self, link: Switchboard) -> None:
        """Opens the device. Raises LinkError."""
        self._link = link
        try:
            self._device = os.open(link.address.host, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError as error:
            raise LinkError(f"link {link.address} cannot be opened: {in_words(error)}") from error
        try:
            _make_raw(self._device, link.address.port)
        except (OSError, termios.error) as error:
            os.close(self._device)
            raise LinkError(f"link {link.address} cannot be opened: it is not a serial device") from error
        self._waiting = bytearray()
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._device, self._read)
        self._open = True
        self._peer = link.add_peer(self, str(link.address), self._write)
        self._peer.waiting = lambda: len(self._waiting)
        self.lost: asyncio.Future[str] = self._loop.create_future()

    def close(self, why: str = "closed") -> None:
        if self._open:
            self._open = False
            self._loop.remove_reader(self._device)
            self._loop.remove_writer(self._device)
            os.close(self._device)
            self._link.drop_peer(self)
            if not self.lost.done():
                self.lost.set_result(why)

    def _read(self) -> None:
        try:
            data = os.read(self._device, _READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            self.close(in_words(error))
            return
        if data:
            self._link.received(self._peer, data, datagram=False)
        else:
            self.close("the device was unplugged")

    def _write(self, data: bytes) -> bool:
        if not self._open or len(self._waiting) > MAX_QUEUED_BYTES:
            return False
        idle = not self._waiting
        self._waiting += data
        if idle:
            self._flush()
        return self._open

    def _flush(self) -> None:
        try:
            written = os.write(self._device, self._waiting)
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.EWOULDBLOCK):
                self.close(in_words(error))
                return
            written = 0
        del self._waiting[:written]
        if self._waiting:
            self._loop.add_writer(self._device, self._flush)
        else:
            self._loop.remove_writer(self._device)


def _make_raw(device: int, baud: int) -> None:
    tty.setraw(device)
    settings = termios.tcgetattr(device)
    speed = getattr(termios, f"B{baud}")
    settings[2] = settings[2] & ~termios.CRTSCTS & ~termios.CSTOPB & ~termios.PARENB | termios.CLOCAL | termios.CREAD
    settings[4] = settings[5] = speed
    termios.tcsetattr(device, termios.TCSANOW, settings)
