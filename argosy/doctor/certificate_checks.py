"""The doctor's check of certificates: this machine's own, and those that the boards show when they are called."""

from __future__ import annotations

import socket
import ssl
import time
from pathlib import Path

from argosy.doctor.findings import Said
from commd.bus.tls import SOON, Identity, Tls, day, files_in, identity_of, out_of_date, shown_by
from schemas.files.findings import Findings
from schemas.files.units import host_and_port
from schemas.humanize import count
from schemas.mission.model import DEFAULT_PORT, Mission

CALL_PATIENCE = 3.0
"""Wall seconds that a board has to show its certificate."""
RENEW = "on the machine that has the fleet's authority: `argosy keys renew`, then copy the folder and restart commd"

UNBELIEVED = (
    "copy this machine's new ca.pem here, if boards were added (`argosy keys add-board`); else that board was revoked, "
    "or has another fleet's keys"
)


def certificates(mission: Mission, folder: Path | None) -> list[Said]:
    """Look at the dates of all certificates that can be seen with the keys of this machine, if it was given any."""
    if folder is None:
        return []
    tls, now = files_in(Path(folder)), time.time()
    try:
        own = identity_of(tls, now)
    except Findings as findings:
        return [Said("error", "certificates", one.message, "see docs/guides/security.md") for one in findings.findings]
    said = _dates("this machine's", own, now)
    seen = [own.ends]
    for board, entry in mission.boards.items():
        if not entry.address:
            continue
        try:
            theirs = shown_at(tls, *host_and_port(entry.address, DEFAULT_PORT))
        except ssl.SSLCertVerificationError as error:
            text = f"{board} shows one at {entry.address} that our ca.pem does not believe: {error.verify_message}"
            said.append(Said("error", "certificates", text, UNBELIEVED))
            continue
        except OSError as error:
            text = f"{board} shows none at {entry.address}: {error.strerror or error}"
            do = f"is {board} there, and its commd with its keys?"
            said.append(Said("error", "certificates", text, do))
            continue
        seen.append(theirs.ends)
        if theirs.name != board:
            text = f"who answers for {board} at {entry.address} is `{theirs.name}`"
            said.append(Said("error", "certificates", text, "two boards have each other's address or keys"))
        said += _dates(f"{board}'s", theirs, now)
    if not said:
        text = f"{count(len(seen), 'certificate')}, the first ends on {day(min(seen))}"
        said.append(Said("ok", "certificates", text))
    return said


def shown_at(tls: Tls, host: str, port: int) -> Identity:
    """Call a board and return what its certificate says, whatever its dates. Raises OSError."""
    with (
        socket.create_connection((host.strip("[]"), port), CALL_PATIENCE) as plain,
        shown_by(plain, tls) as (theirs, _),
    ):
        return theirs


def _dates(whose: str, identity: Identity, now: float) -> list[Said]:
    if now < identity.begins:
        text = f"{whose} certificate: {out_of_date(identity, now)}"
        return [Said("error", "certificates", text, "compare the clocks: no other machine lets that one in")]
    if identity.ends - now > SOON:
        return []
    left = (identity.ends - now) / 86_400
    text = f"{whose} certificate (`{identity.name}`) ends on {day(identity.ends)}, in {left:.0f} days"
    if left <= 0:
        text = f"{whose} certificate (`{identity.name}`) expired on {day(identity.ends)}: no other machine lets it in"
    return [Said("warning" if left > 0 else "error", "certificates", text, RENEW)]
