"""A machine's keys: its identity for other machines, and whom it trusts (docs/guides/security.md).

A folder of keys has `ca.pem` (trusted certificates), `cert.pem` (its own) and `key.pem` (its secret). `argosy keys`
makes it; here it is only read, with the standard library.
"""

from __future__ import annotations

import socket
import ssl
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path
from typing import Any

from schemas.files.findings import Findings
from schemas.mission.model import Mission

ROOT, CERTIFICATE, KEY = "ca.pem", "cert.pem", "key.pem"
"""The files in a folder of keys."""
SOON = 30 * 86_400.0
"""Seconds before its end from which on a certificate should be renewed."""
_NO_CHECK_TIME = 0x200000
"""OpenSSL's X509_V_FLAG_NO_CHECK_TIME: the dates of a certificate are checked separately."""


@dataclass(frozen=True)
class Tls:
    """The files of a machine's keys."""

    root: Path
    certificate: Path
    key: Path

    def settings(self) -> dict[str, Any]:
        """Return Zenoh's `transport/link/tls`: mutual TLS, names must match, a link ends with its certificate."""
        return {
            "root_ca_certificate": str(self.root),
            "listen_certificate": str(self.certificate),
            "listen_private_key": str(self.key),
            "connect_certificate": str(self.certificate),
            "connect_private_key": str(self.key),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
        }


@dataclass(frozen=True)
class Identity:
    """The identity in a certificate."""

    name: str
    """Common name: the board, operator or observer."""
    addresses: tuple[str, ...]
    """Host names and IP addresses of the machine."""
    begins: float
    """Unix time."""
    ends: float
    """Unix time."""

    def is_at(self, host: str) -> bool:
        """Whether the certificate is for a host name or an IP address."""
        return _same(host) in {_same(address) for address in self.addresses}


def files_in(folder: Path) -> Tls:
    """Return the paths of a folder of keys, which may be on another machine."""
    return Tls(folder / ROOT, folder / CERTIFICATE, folder / KEY)


def tls_in(folder: Path) -> Tls:
    """Return the keys in a folder, checked except for their dates: a clock may be set later. Raises Findings."""
    tls = files_in(folder)
    identity_in(tls)
    return tls


def identity_of(tls: Tls, now: float) -> Identity:
    """Return the identity in the keys. Raises Findings for keys that no machine would accept `now` (Unix seconds)."""
    identity = identity_in(tls)
    if words := out_of_date(identity, now):
        raise Findings.about(tls.certificate, words)
    return identity


def identity_in(tls: Tls) -> Identity:
    """Return the identity in the keys, whatever their dates. Raises Findings for invalid keys."""
    for file, what in ((tls.root, "whom to believe"), (tls.certificate, "the certificate"), (tls.key, "its key")):
        _readable(file, what)
    if stat.S_IMODE(tls.key.stat().st_mode) & 0o077:
        raise Findings.about(tls.key, f"others on this machine may read the key: `chmod 600 {tls.key}`")
    return _shown(tls)


def out_of_date(identity: Identity, now: float) -> str:
    """Return a text if a certificate is not valid yet or has expired `now` (Unix seconds); empty if it is valid."""
    if now < identity.begins:
        text = f"the certificate of `{identity.name}` is valid from {day(identity.begins)} on, and this machine's clock"
        return f"{text} says {day(now)}: set the clock"
    if now >= identity.ends:
        text = f"the certificate of `{identity.name}` expired on {day(identity.ends)} (it is {day(now)}): on the"
        return f"{text} operator's machine, `argosy keys renew` makes another"
    return ""


def check_board(tls: Tls, mission: Mission, board: str) -> None:
    """Raise Findings for keys of another board, or for another address.

    Dates are not checked: a board also works without other machines, and a clock may be set later
    (`commd.router.link_monitor`).
    """
    identity = identity_in(tls)
    if identity.name != board:
        raise Findings.about(tls.certificate, f"the keys are those of `{identity.name}`, and this is board `{board}`")
    host = mission.host_of(board)
    if host and not identity.is_at(host):
        text = f"the other boards reach `{board}` at {host}, and its certificate is for {', '.join(identity.addresses)}"
        raise Findings.about(tls.certificate, f"{text}: `argosy keys renew` with this mission makes it another")


def day(at: float) -> str:
    """Return a Unix time in seconds as text, in UTC."""
    return time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(at))


def _shown(tls: Tls) -> Identity:
    """Make a TLS handshake with ourselves in memory, and return the identity that the client shows."""
    server, client = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER), ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    server.verify_mode = ssl.CERT_REQUIRED
    server.verify_flags = ssl.VerifyFlags(_NO_CHECK_TIME | ssl.VERIFY_X509_PARTIAL_CHAIN)
    client.check_hostname, client.verify_mode = False, ssl.CERT_NONE
    try:
        server.load_verify_locations(tls.root)
    except ssl.SSLError:
        raise Findings.about(tls.root, "expected certificates in PEM, such as `argosy keys` writes") from None
    for side in (server, client):
        _show(side, tls)
    to_client, to_server = ssl.MemoryBIO(), ssl.MemoryBIO()
    there = server.wrap_bio(to_server, to_client, server_side=True)
    here = client.wrap_bio(to_client, to_server)
    try:
        for end in (here, there, here, there):
            try:
                end.do_handshake()
            except ssl.SSLWantReadError:
                continue
        return _read(there.getpeercert() or {})
    except ssl.SSLCertVerificationError as error:
        text = f"the certificate is none that {tls.root} believes: the two are of different fleets, or it was revoked"
        raise Findings.about(tls.certificate, f"{text} ({error.verify_message})") from None
    except (ssl.SSLError, KeyError) as error:
        raise Findings.about(tls.certificate, f"cannot be used: {error}") from None


@contextmanager
def shown_by(connection: socket.socket, tls: Tls) -> Iterator[tuple[Identity, ssl.SSLSocket]]:
    """Make a TLS handshake, and yield the other side's identity, whatever its dates and names, and the session.

    Raises ssl.SSLCertVerificationError if the keys do not trust it, other OSErrors if it is not TLS.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_flags = ssl.VerifyFlags(_NO_CHECK_TIME | ssl.VERIFY_X509_PARTIAL_CHAIN)
    context.load_verify_locations(tls.root)
    _show(context, tls)
    with context.wrap_socket(connection) as session:
        yield _read(session.getpeercert() or {}), session


def _show(side: ssl.SSLContext, tls: Tls) -> None:
    try:
        side.load_cert_chain(tls.certificate, tls.key, password=_no_password)
    except ssl.SSLError as error:
        if error.reason == "KEY_VALUES_MISMATCH":
            raise Findings.about(tls.certificate, f"is the certificate of another key than {tls.key}") from None
        raise Findings.about(tls.certificate, f"expected a certificate in PEM, and its key in {tls.key}") from None
    except ValueError as error:
        raise Findings.about(tls.key, str(error)) from None


def _read(certificate: dict[str, Any]) -> Identity:
    names = [value for part in certificate["subject"] for field, value in part if field == "commonName"]
    return Identity(
        names[0] if names else "",
        tuple(address for _, address in certificate.get("subjectAltName", ())),
        ssl.cert_time_to_seconds(certificate["notBefore"]),
        ssl.cert_time_to_seconds(certificate["notAfter"]),
    )


def _same(host: str) -> str:
    """Return the canonical spelling of a host name or IP address."""
    try:
        return ip_address(host).compressed
    except ValueError:
        return host.lower()


def _readable(file: Path, what: str) -> None:
    try:
        file.read_bytes()
    except PermissionError as error:
        text = f"cannot be read ({what}): {error.strerror}: keys are for their owner, and this user is another one"
        do = "on a board, `sudo systemd-tmpfiles --create argosy-MISSION.conf` gives them to its commd"
        raise Findings.about(file, f"{text}; {do}") from None
    except OSError as error:
        text = f"cannot be read ({what}): {error.strerror}"
        raise Findings.about(file, f"{text}; `argosy keys add-board` makes a machine's folder of keys") from None


def _no_password() -> str:
    raise ValueError("is protected by a password: a daemon cannot ask for it")
