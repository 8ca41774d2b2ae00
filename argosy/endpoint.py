"""Whether a router can listen at an endpoint, asked before anything starts."""

from __future__ import annotations

import errno
import re
import socket
from contextlib import suppress

_TCP = re.compile(r"tcp/(?:\[(?P<six>[^\]]+)\]|(?P<host>[^:/?#]+)):(?P<port>\d+)")


def in_use(endpoint: str) -> str:
    """Return in words why nobody can listen there; nothing if one can, or if only Zenoh can tell (not TCP)."""
    found = _TCP.match(endpoint)
    if found is None:
        return ""
    host, port = found["six"] or found["host"], int(found["port"])
    try:
        addresses = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except (OSError, OverflowError) as error:
        return f"is no address to listen at ({error})"
    for family, kind, protocol, _, address in addresses[:1]:
        with socket.socket(family, kind, protocol) as probe:
            with suppress(OSError):
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # a port in TIME_WAIT is free
            try:
                probe.bind(address)
                probe.listen(1)
            except OSError as error:
                return "is in use" if error.errno == errno.EADDRINUSE else f"cannot be listened at ({error.strerror})"
    return ""
