"""Zenoh endpoints as users write them: `tcp/127.0.0.1:7447`, `unixsock-stream//run/argosy/commd.sock`."""

from __future__ import annotations

import re

_ADDRESS = re.compile(r"(?:tcp|udp|tls|quic|ws)/(?:\[[0-9A-Fa-f:.%a-z]+\]|[A-Za-z0-9_.-]+):(\d{1,5})")
_SOCKET = re.compile(r"unixsock-stream/.+")


def check_endpoint(text: str) -> str:
    """Return an endpoint as it is, or raise ValueError that says what was expected."""
    address = _ADDRESS.fullmatch(text)
    if _SOCKET.fullmatch(text) or (address and 0 < int(address[1]) < 65536):
        return text
    raise ValueError(f"Expected an endpoint such as `tcp/127.0.0.1:7447`, got `{text}`")
