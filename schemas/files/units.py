"""Distances, durations and endpoints as people write them in missions, manifests and on command lines."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from typing import ClassVar, Final, Self

LINK_FORMS: Final = "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT or serial:DEVICE:BAUD"
"""The forms that a MAVLink link can have, for errors and help texts."""
_LARGEST: Final = sys.float_info.max
"""A TOML or YAML integer may be larger than any float."""
_NUMBER: Final = re.compile(r"(\d+(?:\.\d+)?)\s*([a-z]*)")


class _Quantity(float):
    """A number of the base unit, read from a number or from a number with a unit."""

    UNITS: ClassVar[Mapping[str, float]]
    """Factor of each unit; the base unit, which needs not be written, has 1."""
    EXPECTED: ClassVar[str]

    @classmethod
    def read(cls, value: object) -> Self:
        """Read a value of 0 or more. Raises ValueError that says what was expected."""
        if isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value <= _LARGEST:
            return cls(value)
        if isinstance(value, str) and (found := _NUMBER.fullmatch(value.strip())):
            factor = cls.UNITS.get(found[2]) if found[2] else 1.0
            if factor is not None and (amount := float(found[1]) * factor) < float("inf"):
                return cls(amount)
        raise ValueError(f"Expected a {cls.EXPECTED}, got `{value}`")


class Distance(_Quantity):
    """A length in metres, such as `300m`, `1.5km`, or a number of metres."""

    UNITS: ClassVar[Mapping[str, float]] = {"m": 1.0, "km": 1000.0}
    EXPECTED = "distance such as `300m` or `1.5km`"

    def __str__(self) -> str:
        return f"{self / 1000:g}km" if self >= 1000 else f"{float(self):g}m"


class Duration(_Quantity):
    """A length of time in seconds, such as `5s`, `500ms`, `15min`, `1h`, or a number of seconds."""

    UNITS: ClassVar[Mapping[str, float]] = {"ms": 0.001, "s": 1.0, "min": 60.0, "m": 60.0, "h": 3600.0}
    EXPECTED = "duration such as `5s`, `500ms` or `15min`"

    def __str__(self) -> str:
        if self >= 60 and self % 60 == 0:
            return f"{self / 60:g}min"
        return f"{self * 1000:g}ms" if 0 < self < 1 else f"{float(self):g}s"


def decode_hook(expected: type, value: object) -> object:
    """Return a value as one of these types: msgspec's `dec_hook`. Raises ValueError that says what was expected."""
    if issubclass(expected, _Quantity):
        return expected.read(value)
    raise NotImplementedError(f"no decoding for {expected!r}")


_ADDRESS = re.compile(r"(?:tcp|udp|tls|quic|ws)/(?:\[[0-9A-Fa-f:.%a-z]+\]|[A-Za-z0-9_.-]+):(\d{1,5})")
_HOST = re.compile(r"(\[[0-9A-Fa-f:.%a-z]+\]|[A-Za-z0-9_.-]+)(?::(\d{1,5}))?")
_SOCKET = re.compile(r"unixsock-stream/.+")


def check_endpoint(text: str) -> str:
    """Return a Zenoh endpoint as it is. Raises ValueError that says what was expected."""
    address = _ADDRESS.fullmatch(text)
    if _SOCKET.fullmatch(text) or (address and 0 < int(address[1]) < 65536):
        return text
    raise ValueError(f"Expected an endpoint such as `tcp/127.0.0.1:7447`, got `{text}`")


def host_and_port(text: str, default: int | None = None) -> tuple[str, int]:
    """Read `HOST:PORT` (`[HOST]:PORT` for IPv6), or `HOST` if there is a default port.

    Raises ValueError that says what was expected.
    """
    found = _HOST.fullmatch(text)
    port = int(found[2]) if found and found[2] else default
    if found is None or port is None or not 0 < port < 65536:
        raise ValueError(f"Expected {'HOST or ' if default else ''}HOST:PORT such as `10.0.0.7:9000`, got `{text}`")
    return found[1], port
