"""What a robot listens to: one publisher for each key that an action puts to, and its last value for late ones."""

from __future__ import annotations

from commd.bus.raw import RawBus, Sample


class Topic:
    """A key to put to."""

    def __init__(self, raw: RawBus, key: str, *, latch: bool) -> None:
        """With `latch` the last value that was sent answers queries on the key."""
        self.key = key
        self._publisher = raw.publisher(key)
        self._last: Sample | None = None
        self._queryable = raw.serve(key, lambda _: self._last) if latch else None

    @property
    def heard(self) -> bool:
        """Whether anybody listens now."""
        return self._publisher.matching

    def put(self, payload: bytes, encoding: str) -> None:
        """Send to all who listen. Raises OSError."""
        self._publisher.put(payload, encoding)
        self._last = Sample(self.key, payload, encoding)

    def close(self) -> None:
        """Send no more."""
        self._publisher.close()
        if self._queryable is not None:
            self._queryable.close()
