"""Endpoints as users write them: Zenoh's, such as `tcp/127.0.0.1:7447`, and `HOST:PORT`."""

from __future__ import annotations

import re

_ADDRESS = re.compile(r"(?:tcp|udp|tls|quic|ws)/(?:\[[0-9A-Fa-f:.%a-z]+\]|[A-Za-z0-9_.-]+):(\d{1,5})")
_HOST = re.compile(r"(\[[0-9A-Fa-f:.%a-z]+\]|[A-Za-z0-9_.-]+)(?::(\d{1,5}))?")
_SOCKET = re.compile(r"unixsock-stream/.+")


def check_endpoint(text: str) -> str:
    """Return an endpoint as it is, or raise ValueError that says what was expected."""
    address = _ADDRESS.fullmatch(text)
    if _SOCKET.fullmatch(text) or (address and 0 < int(address[1]) < 65536):
        return text
    raise ValueError(f"Expected an endpoint such as `tcp/127.0.0.1:7447`, got `{text}`")


def host_and_port(text: str, default: int | None = None) -> tuple[str, int]:
    """Read `HOST:PORT` (`[HOST]:PORT` for IPv6), or `HOST` where there is a default. Raises ValueError in words."""
    found = _HOST.fullmatch(text)
    port = int(found[2]) if found and found[2] else default
    if found is None or port is None or not 0 < port < 65536:
        raise ValueError(f"Expected {'HOST or ' if default else ''}HOST:PORT such as `10.0.0.7:9000`, got `{text}`")
    return found[1], port
