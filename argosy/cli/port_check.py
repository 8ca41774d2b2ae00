"""Endpoints on the command line, and whether their ports are free."""

from __future__ import annotations

import errno
import re
import socket
from argparse import ArgumentTypeError
from contextlib import suppress
from ipaddress import ip_address
from typing import TYPE_CHECKING

from schemas.files.units import check_endpoint

if TYPE_CHECKING:
    from bridged.drivers.mavlink.transport.address import LinkAddress  # `argosy stop` must be quick

_TCP = re.compile(r"tcp/(?:\[(?P<six>[^\]]+)\]|(?P<host>[^:/?#]+)):(?P<port>\d+)")


def endpoint(text: str) -> str:
    """Read an endpoint. Raises ArgumentTypeError."""
    try:
        return check_endpoint(text)
    except ValueError as error:
        raise ArgumentTypeError(str(error)) from None


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches a host, which may be in brackets."""
    try:
        return ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"


def in_use(endpoint: str) -> str:
    """Return why an endpoint cannot be listened at; empty = it can, or it is not TCP."""
    found = _TCP.match(endpoint)
    if found is None:
        return ""
    return _taken(found["six"] or found["host"], int(found["port"]), socket.SOCK_STREAM)


def link_in_use(link: LinkAddress) -> str:
    """Return why a `udpin` or `tcpin` link cannot be bound; empty = it can."""
    return _taken(link.host, link.port, socket.SOCK_DGRAM if link.kind == "udpin" else socket.SOCK_STREAM)


def _taken(host: str, port: int, transport: socket.SocketKind) -> str:
    try:
        addresses = socket.getaddrinfo(host, port, type=transport, flags=socket.AI_PASSIVE)
    except (OSError, OverflowError) as error:
        return f"is not an address of this machine ({error})"
    for family, kind, protocol, _, address in addresses[:1]:
        with socket.socket(family, kind, protocol) as probe:
            try:
                if kind == socket.SOCK_STREAM:
                    with suppress(OSError):
                        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # a port in TIME_WAIT is free
                probe.bind(address)
                if kind == socket.SOCK_STREAM:
                    probe.listen(1)
            except OSError as error:
                return "is in use" if error.errno == errno.EADDRINUSE else f"cannot be listened at ({error.strerror})"
    return ""
