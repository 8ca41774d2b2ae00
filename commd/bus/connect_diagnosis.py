"""Diagnose why an endpoint is not reached: Zenoh reports only that a connection failed.

The connection is tried again with the standard library's sockets and TLS.
"""

from __future__ import annotations

import asyncio
import re
import socket
import ssl
import time
from concurrent.futures import Future
from contextlib import closing
from threading import Lock, Thread

from commd.bus.tls import Identity, Tls, day, identity_of, shown_by
from schemas.files.findings import Findings

PATIENCE = 2.0
"""Wall seconds for each step of an attempt: the connection, and the handshake."""
VERDICT = 0.5
"""Wall seconds for the other side to reject our certificate; it sends nothing if it accepts it."""
EMPTY_FRAME = b"\0\0\r\n\r\n"
"""A frame of Zenoh (its length in two bytes) without a message, which a router answers by a frame with `CLOSE`; and the
end of a request in protocols of lines, which is answered, too."""
LENGTH, MESSAGE_ID, CLOSE = 2, 0x1F, 3
"""Bytes of a frame's length; the bits of a message's first byte that are its id; that of Zenoh's Close."""
HANGS_UP = "it hangs up before it says who it is: overloaded, or a router without keys"
_PLACE = re.compile(r"(tcp|tls)/(?:\[([^\]]+)\]|([^:/?#]+)):(\d+)")
_UNIX = "unixsock-stream/"
_attempts: dict[tuple[str, Tls | None], Future[str]] = {}
"""Attempts under way."""
_lock = Lock()
_OUR_DATES = {"SSLV3_ALERT_CERTIFICATE_EXPIRED"}
_TRY_LATER = "TLSV1_ALERT_INTERNAL_ERROR"
"""The alert of `commd.router.admission` for a connection that may not begin a handshake now."""
_OUR_NAME = {
    "TLSV1_ALERT_UNKNOWN_CA",
    "SSLV3_ALERT_BAD_CERTIFICATE",
    "SSLV3_ALERT_CERTIFICATE_UNKNOWN",
    "TLSV1_ALERT_DECRYPT_ERROR",
    "TLSV1_ALERT_ACCESS_DENIED",
}


async def why_not(endpoint: str, tls: Tls | None) -> str:
    """Return why no router is reached at an endpoint, for people; empty if the attempt succeeded."""
    try:
        return await asyncio.wait_for(asyncio.wrap_future(_asked(endpoint, tls)), 3 * PATIENCE)
    except TimeoutError:
        return "the name service does not answer"


def _asked(endpoint: str, tls: Tls | None) -> Future[str]:
    """Start an attempt in a thread of its own, or join the one under way.

    A name service may block a thread for long, and nothing can end it: so there is at most one for each endpoint, and
    no thread of a shared pool.
    """
    with _lock:
        if (under_way := _attempts.get((endpoint, tls))) is not None:
            return under_way
        asked = _attempts[endpoint, tls] = Future[str]()
        asked.set_running_or_notify_cancel()  # a waiter that is cancelled does not cancel it for the others

    def try_it() -> None:
        try:
            found, error = attempt(endpoint, tls), None
        except BaseException as defect:
            found, error = "", defect
        with _lock:
            del _attempts[endpoint, tls]
        if error is not None:
            asked.set_exception(error)
        else:
            asked.set_result(found)

    Thread(target=try_it, name="reaching", daemon=True).start()
    return asked


def attempt(endpoint: str, tls: Tls | None) -> str:
    """Try to connect, and return what went wrong; blocks for `PATIENCE` and the name service."""
    if endpoint.startswith(_UNIX):
        return _attempt_socket(endpoint.removeprefix(_UNIX))
    found = _PLACE.match(endpoint)
    if found is None:
        return ""
    protocol, host, port = found[1], found[2] or found[3], int(found[4])
    if protocol == "tls" and tls is None:
        return "it is reached with keys alone: say where they are by --keys FOLDER"
    try:
        with socket.create_connection((host, port), PATIENCE) as connection:
            if protocol == "tcp" or tls is None:
                if _speaks_tls(connection):
                    return "it speaks TLS: say `tls/...`, and --keys FOLDER"
            else:
                return _attempt_tls(connection, host, tls)
        with socket.create_connection((host, port), PATIENCE) as connection:
            return "what listens there is no Zenoh router" if _speaks_otherwise(connection) else ""
    except socket.gaierror:
        return f"there is no host `{host}` by what the name service says"
    except ConnectionRefusedError:
        return "is commd running? Nobody listens there"
    except TimeoutError:
        return f"{host} does not answer: is it on, and in this network?"
    except OSError as error:
        return f"{host} is not reached: {error.strerror or error}"


def _attempt_socket(path: str) -> str:
    try:
        with closing(socket.socket(socket.AF_UNIX)) as connection:
            connection.settimeout(PATIENCE)
            connection.connect(path)
    except FileNotFoundError:
        return "is commd running? There is no such socket"
    except PermissionError:
        return "this user may not use the socket: it is for the members of its group (`ls -ld` of it and its folder)"
    except OSError as error:
        return f"is commd running? {error.strerror or error}"
    return ""


def _speaks_tls(connection: socket.socket) -> bool:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    connection.settimeout(VERDICT)
    try:
        with context.wrap_socket(connection):
            return True
    except OSError:
        return False


def _speaks_otherwise(connection: socket.socket) -> bool:
    """Whether the other side answers what no Zenoh router does. Of one that is silent or hangs up it is not known."""
    connection.settimeout(VERDICT)
    try:
        connection.sendall(EMPTY_FRAME)
        answer = connection.recv(64)
    except OSError:
        return False
    return bool(answer) and not (len(answer) > LENGTH and answer[LENGTH] & MESSAGE_ID == CLOSE)


def _attempt_tls(connection: socket.socket, host: str, tls: Tls) -> str:
    try:
        ours = identity_of(tls, time.time())
    except Findings as findings:
        return f"our own keys: {findings}"
    try:
        with shown_by(connection, tls) as (theirs, session):
            return _judged(theirs, host) or _verdict(session, ours)
    except Findings as findings:  # the files were just replaced
        return f"our own keys: {findings}"
    except ssl.SSLCertVerificationError as error:
        text = "who is there has a certificate that our ca.pem does not believe: another fleet's, or a revoked one"
        text += ", or ours is older than it: `argosy keys` makes a new ca.pem when somebody is added"
        return f"{text} ({error.verify_message})"
    except TimeoutError:
        return f"it connects and says nothing within {PATIENCE:g} s: overloaded, hung, or a router without keys"
    except ssl.SSLError as error:
        if error.reason == _TRY_LATER:
            text = "it takes no more handshakes from this address for some seconds: too many failed or are under way"
            return f"{text}; its log says from whom"
        if not isinstance(error, ssl.SSLEOFError):
            return "what listens there speaks no TLS: a router without keys?"
        return HANGS_UP
    except ConnectionError:
        return HANGS_UP


def _judged(theirs: Identity, host: str) -> str:
    """Return what is wrong with the other side's certificate at `host`; empty if nothing is."""
    now = time.time()
    if now >= theirs.ends:
        return f"its certificate, `{theirs.name}`, expired on {day(theirs.ends)}: `argosy keys renew` makes another"
    if now < theirs.begins:
        text = f"its certificate, `{theirs.name}`, is valid from {day(theirs.begins)} on"
        return f"{text}, and the clock here says {day(now)}: set it"
    if not theirs.is_at(host):
        places = ", ".join(theirs.addresses) or "no address"
        text = f"who is there is `{theirs.name}`, with a certificate for {places} and not for {host}"
        return f"{text}: is that board at this address? then `argosy keys renew` makes it another"
    return ""


def _verdict(session: ssl.SSLSocket, ours: Identity) -> str:
    """Return why the other side rejects our certificate; empty if it does not."""
    session.settimeout(VERDICT)
    try:
        session.recv(1)
    except ssl.SSLError as error:
        if error.reason in _OUR_DATES:
            span = f"it is valid from {day(ours.begins)} to {day(ours.ends)}"
            return (
                f"it says that the certificate of `{ours.name}` is expired or not valid yet ({span}): is its clock set?"
            )
        if error.reason in _OUR_NAME:
            text = f"it does not believe the certificate of `{ours.name}`: another fleet's, or a revoked one"
            return f"{text}, or its ca.pem is older than that"
        return f"it refuses the certificate of `{ours.name}` ({error.reason})"
    except OSError:
        return ""
    return ""
