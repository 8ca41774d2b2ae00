"""Link strings: where the other end of a MAVLink link is."""

from dataclasses import dataclass
from typing import Literal, Self, cast, get_args

from schemas.files.units import LINK_FORMS

LinkKind = Literal["udpin", "udpout", "tcp", "tcpin", "serial"]

BAUD_RATES = (
    1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400, 460800, 500000, 576000,
    921600, 1000000, 1152000, 1500000, 2000000, 2500000, 3000000, 3500000, 4000000,
)  # fmt: skip
"""Serial speeds in bit/s that Linux terminals know by name."""


class LinkAddressError(ValueError):
    """A link string that cannot be understood; `text` is the string, the message says what was expected."""

    def __init__(self, text: str, problem: str) -> None:
        super().__init__(f"link {text!r}: {problem}")
        self.text = text


@dataclass(frozen=True, slots=True)
class LinkAddress:
    """One end of a MAVLink link.

    `udpin` and `tcpin` listen on `host:port`; `udpout` and `tcp` call `host:port`; `serial` opens the
    device `host` at `port` bit/s.
    """

    kind: LinkKind
    host: str
    port: int

    @classmethod
    def parse(cls, text: str) -> Self:
        """Reads `kind:HOST:PORT` or `serial:DEVICE:BAUD`; IPv6 hosts are in brackets. Raises LinkAddressError."""
        kind, colon, rest = text.partition(":")
        if not colon or kind not in get_args(LinkKind):
            raise LinkAddressError(text, f"expected {LINK_FORMS}")
        host, colon, number = rest.rpartition(":")
        if not colon or not host:
            raise LinkAddressError(text, f"expected {_form(kind)}")
        if not (number.isascii() and number.isdigit()) or len(number) > 9:
            raise LinkAddressError(text, f"expected a number after the last colon ({_form(kind)}), got {number!r}")
        port = int(number)
        if kind == "serial":
            if port not in BAUD_RATES:
                raise LinkAddressError(text, f"expected a usual baud rate such as 57600, 115200 or 921600, got {port}")
            if "\0" in host:
                raise LinkAddressError(text, "a device name cannot hold a null byte")
            return cls("serial", host, port)
        host = _bare_host(text, host)
        lowest = 0 if kind in ("udpin", "tcpin") else 1
        if not lowest <= port <= 65535:
            raise LinkAddressError(text, f"expected a port between {lowest} and 65535, got {port}")
        return cls(cast(LinkKind, kind), host, port)

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host and self.kind != "serial" else self.host
        return f"{self.kind}:{host}:{self.port}"


def _form(kind: str) -> str:
    return "serial:DEVICE:BAUD" if kind == "serial" else f"{kind}:HOST:PORT"


def _bare_host(text: str, host: str) -> str:
    if host.startswith("[") and host.endswith("]"):
        host = host[1:-1]
    elif ":" in host:
        raise LinkAddressError(text, f"an IPv6 host is written in brackets, as in [{host}]")
    if not host or len(host) > 253 or any(c.isspace() or not c.isprintable() or c in "/[]" for c in host):
        raise LinkAddressError(text, f"expected a host name or an address, got {host!r}")
    return host


def link_strings(field: str | tuple[str, ...]) -> tuple[str, ...]:
    """The link strings of a field that holds one or more."""
    return (field,) if isinstance(field, str) else field
