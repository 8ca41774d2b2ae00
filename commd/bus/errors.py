"""The errors of the bus. Each derives from the nearest builtin and carries its facts as attributes.

BusError
├── AlreadyRunning (RuntimeError)     another live instance has this daemon's name
├── BusClosed (ConnectionError)       no router, or the session is closed
│   └── AccessDenied                  the router denies what this daemon needs
├── OtherMajor (ConnectionError)      commd speaks another major version of the records
└── QueryFailed                       a query has no usable reply
    └── QueryTimeout (TimeoutError)   nobody serves the key, or no reply came in time

CannotServe is raised by what serves a query, and replied.
"""

from __future__ import annotations


class BusError(Exception):
    """Something went wrong on the bus."""


class AlreadyRunning(BusError, RuntimeError):
    """Another live instance of this daemon's name is on the bus."""


class BusClosed(BusError, ConnectionError):
    """The router could not be reached, or the bus was closed."""


class AccessDenied(BusClosed):
    """The router denies what this daemon needs; the text names what is denied, the router, and the remedy."""


class OtherMajor(BusError, ConnectionError):
    """This daemon cannot work with the board's commd: their records are of two major versions."""


class QueryFailed(BusError):
    """A query on `key` was answered with errors alone; the text is the last one.

    `other_version`: the major version of the replying program's records, if it is not ours. `code`: what is wrong with
    the query's payload (`schemas.wire.codec.BadRecord.code`), if that is why.
    """

    def __init__(self, key: str, error: str, other_version: str = "", *, code: str = "") -> None:
        super().__init__(error)
        self.key, self.other_version, self.code = key, other_version, code


class QueryTimeout(QueryFailed, TimeoutError):
    """A query on `key` had no reply within `timeout` wall seconds.

    `nobody`: it ended without a reply, as no session serves the key or the router denies it.
    """

    def __init__(self, key: str, timeout: float, *, nobody: bool = False) -> None:
        super().__init__(key, "nobody answers" if nobody else f"no answer within {timeout:g} s")
        self.timeout, self.nobody = timeout, nobody


class CannotServe(Exception):
    """A query that cannot be served: raised by its handler, the text is the error reply."""
