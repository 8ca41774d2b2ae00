"""A bounded queue of samples from Zenoh's threads to the recorder's thread."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from threading import Event, Lock
from typing import Literal, NamedTuple

import zenoh

from schemas.wire.codec import MAX_BYTES

MOST, MOST_BYTES = 100_000, 128 * 1024 * 1024
"""Capacity in messages and in bytes; further messages are dropped and counted."""
ENOUGH, ENOUGH_BYTES = 4_000, 2 * 1024 * 1024
"""Messages or bytes that wake the recorder before its period is over."""
Origin = Literal["put", "query", "token", "recorder"]


class Heard(NamedTuple):
    """A sample received on the bus."""

    at: int
    """Unix nanoseconds."""
    key: str
    payload: bytes
    encoding: str
    origin: Origin = "put"
    deleted: bool = False


def steady_clock() -> Callable[[], int]:
    """Return a clock of Unix nanoseconds that later corrections of the system clock do not affect."""
    ahead = time.time_ns() - time.monotonic_ns()
    return lambda: time.monotonic_ns() + ahead


class WriteQueue:
    """Filled by any thread, emptied by one."""

    def __init__(self, most: int = MOST, most_bytes: int = MOST_BYTES) -> None:
        """`most` and `most_bytes`: capacity in messages and in bytes."""
        self.dropped = self.too_large = 0
        """Messages that did not fit; and messages larger than any record."""
        self.now = steady_clock()
        self.woken = Event()
        """Set to wake the recorder."""
        self._most, self._most_bytes = most, most_bytes
        self._waiting: deque[Heard | tuple[int, zenoh.Sample]] = deque()
        self._bytes = 0
        self._lock = Lock()

    def sample(self, sample: zenoh.Sample) -> None:
        """Queue a sample, on a thread of Zenoh's; the recorder's thread reads it later."""
        size = len(sample.payload)
        if size > MAX_BYTES:
            with self._lock:
                self.too_large += 1
            return
        self._take_in(size, (self.now(), sample))

    def put(self, heard: Heard) -> None:
        """Queue, or drop and count."""
        self._take_in(len(heard.payload), heard)

    def take(self) -> Iterator[Heard]:
        """Yield and remove everything that is queued."""
        with self._lock:
            taken, self._waiting, self._bytes = self._waiting, deque(), 0
        for one in taken:
            yield one if isinstance(one, Heard) else _read(*one)

    def _take_in(self, size: int, heard: Heard | tuple[int, zenoh.Sample]) -> None:
        with self._lock:
            if len(self._waiting) >= self._most or self._bytes + size > self._most_bytes:
                self.dropped += 1
                return
            self._waiting.append(heard)
            self._bytes += size
            enough = len(self._waiting) >= ENOUGH or self._bytes >= ENOUGH_BYTES
        if enough:
            self.woken.set()


def _read(at: int, sample: zenoh.Sample) -> Heard:
    deleted = sample.kind == zenoh.SampleKind.DELETE
    return Heard(at, str(sample.key_expr), sample.payload.to_bytes(), str(sample.encoding), "put", deleted)
