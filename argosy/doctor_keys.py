"""The doctor's check of certificates: this machine's own, and those that the boards show when they are called."""

from __future__ import annotations

import socket
import ssl
import time
from pathlib import Path
from typing import Any

from argosy.diagnosis import Said, counted
from commd.tls import Tls, day, files_in, identity_of
from schemas.endpoints import host_and_port
from schemas.findings import Findings
from schemas.mission import DEFAULT_PORT, Mission

SOON = 30 * 86_400.0
"""Seconds before its end from which on a certificate is to be renewed."""
CALL_PATIENCE = 3.0
"""Wall seconds that a board has to show its certificate."""
RENEW = "on the machine that has the fleet's authority: `argosy keys renew`, then copy the folder and restart commd"


def certificates(mission: Mission, folder: Path | None) -> list[Said]:
    """Look at the dates of all certificates that can be seen with the keys of this machine, if it was given any."""
    if folder is None:
        return []
    tls, now = files_in(Path(folder)), time.time()
    try:
        own = identity_of(tls, now)
    except Findings as findings:
        return [Said("error", "certificates", one.message, "see docs/security.md") for one in findings.findings]
    said = _dates("this machine's", own.name, own.ends, now)
    seen = [own.ends]
    for board, entry in mission.boards.items():
        if not entry.address:
            continue
        try:
            name, ends = shown_by(tls, *host_and_port(entry.address, DEFAULT_PORT))
        except OSError as error:
            text = f"{board} shows none at {entry.address}: {error.strerror or error}"
            do = f"is {board} there, and its commd with its keys? A certificate that has expired looks the same"
            said.append(Said("error", "certificates", text, do))
            continue
        seen.append(ends)
        if name != board:
            text = f"who answers for {board} at {entry.address} is `{name}`"
            said.append(Said("error", "certificates", text, "two boards have each other's address or keys"))
        said += _dates(f"{board}'s", name, ends, now)
    if not said:
        text = f"{counted(len(seen), 'certificate')}, the first ends on {day(min(seen))}"
        said.append(Said("ok", "certificates", text))
    return said


def shown_by(tls: Tls, host: str, port: int) -> tuple[str, float]:
    """Call a board and return the name and the end (Unix time) of its certificate. Raises OSError."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False  # whom it is for is judged by its name
    context.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN
    context.load_verify_locations(tls.root)
    context.load_cert_chain(tls.certificate, tls.key)
    with (
        socket.create_connection((host.strip("[]"), port), CALL_PATIENCE) as plain,
        context.wrap_socket(plain) as secured,
    ):
        found: dict[str, Any] = secured.getpeercert() or {}
    names = [value for part in found.get("subject", ()) for kind, value in part if kind == "commonName"]
    return str(names[0]) if names else "?", float(ssl.cert_time_to_seconds(str(found["notAfter"])))


def _dates(whose: str, name: str, ends: float, now: float) -> list[Said]:
    if ends - now > SOON:
        return []
    text = f"{whose} certificate (`{name}`) ends on {day(ends)}, in {(ends - now) / 86_400:.0f} days"
    return [Said("warning" if ends > now else "error", "certificates", text, RENEW)]
