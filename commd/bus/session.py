"""Zenoh sessions as Argosy configures, opens and closes them. Every value was measured
(docs/architecture/decisions.md)."""

from __future__ import annotations

import asyncio
import hashlib
import json
import logging
import os
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import Any, Final, Literal, Protocol

import zenoh

from commd.bus.connect_diagnosis import why_not
from commd.bus.errors import BusClosed
from commd.bus.tls import Tls, identity_in
from commd.common.repeated_log import RepeatedLog
from commd.common.tasks import wait_at_most
from schemas.files.findings import Findings

log = logging.getLogger("bus")

LEASE_MS = 2_000
"""A peer that has sent nothing for this long is gone: a hung or disconnected daemon is noticed within 2 s."""
RETRY_MS = 300
BLOCKED_SEND_US = 300_000
"""A router's full send queue blocks for this long, then the link is closed: a hung reader must not stop others."""
PATIENT_SEND_US = 1_000_000
"""The same for a daemon, whose one link is to its router: the router itself may be waiting for others."""
OPEN_TIMEOUT_MS = 1_000
"""One attempt to reach the router. Attempts repeat, so that a stop is noticed in between."""
OPEN_PATIENCE = 15.0
"""Wall seconds that Zenoh has to open a session or to fail."""
STOP_PATIENCE = 1.5
"""The same once this process is to stop."""
CLOSE_PATIENCE = 2.0
"""Timeout for closing a session, in wall seconds. Zenoh itself waits 10 s for an unresponsive router and then fails."""
DIAGNOSE_EVERY = 10.0
"""Wall seconds between two diagnoses of a router that is not reached."""
STARTS_WITHIN = 3.0
"""Wall seconds in which a router that is started together with its clients opens their sessions: nothing is logged."""
UNKNOWN = "it opens no session: a commd that hangs or is at its maximum of links (see its log), or no router"
"""Why a router that can be reached lets nobody in."""
MOST_KEYS: Final = 10_000
"""Keys that a session declares, and keys used once that it remembers; further ones are not declared."""
OPENING, CLOSING = "opening", "closing"
"""Names of the threads in which sessions are opened and closed: Zenoh may block in both."""
RETRY = {"period_init_ms": RETRY_MS, "period_max_ms": RETRY_MS, "period_increase_factor": 1}
NO_SCOUTING = {"delay": 0, "multicast": {"enabled": False}, "gossip": {"enabled": False}}
READ_ONLY = {"enabled": True, "permissions": {"read": True, "write": False}}


def session_id(name: str = "") -> str:
    """Return a new Zenoh id for a session of the machine whose certificate has this name; "" = by a board's socket.

    A router refuses the second of two sessions with one id, and everybody can read all ids. So an id shows its owner,
    and a board's router disconnects whoever uses another's (`commd.router.admission`).
    """
    return _begins(name) + os.urandom(9).hex() + "f"


def set_id(config: zenoh.Config, board: str) -> None:
    """Give the router of a board an id that shows its owner."""
    config.insert_json5("id", json.dumps(session_id(board)))


def owner_of(zid: str, names: Iterable[str]) -> str | None:
    """Return the machine of an id, or "" for a daemon at its board's socket; None if it is of neither."""
    return next((name for name in ("", *names) if zid.startswith(_begins(name))), None)


def _name_in(tls: Tls) -> str:
    """Return the name in a certificate; `?` for one that nobody would accept."""
    try:
        return identity_in(tls).name
    except Findings:
        return "?"


def _begins(name: str) -> str:
    return "a" + hashlib.sha256(f"argosy session of {name}".encode()).hexdigest()[:12]


def listening_late(endpoint: str, listen: Sequence[str]) -> dict[str, Any]:
    """Return Zenoh's `listen` of a router that needs its own endpoint now, and the others as soon as they exist."""
    endpoints = [f"{endpoint}#exit_on_failure=true", *listen]
    return {"endpoints": endpoints, "timeout_ms": -1, "exit_on_failure": False, "retry": RETRY}


def dialling(connect: Sequence[str]) -> dict[str, Any]:
    """Return Zenoh's `connect` of a router that dials others for ever, and waits for none."""
    return {"endpoints": list(connect), "timeout_ms": -1, "exit_on_failure": False, "retry": RETRY}


def session_config(
    mode: Literal["client", "router"],
    endpoint: str,
    name: str,
    *,
    listen: Sequence[str] = (),
    connect: Sequence[str] = (),
    listen_late: bool = False,
    tls: Tls | None = None,
) -> zenoh.Config:
    """Return the configuration of a daemon's session, or of the board's router.

    A router listens at `listen` besides its endpoint, and dials the routers at `connect` for ever. With `listen_late`
    it opens although the addresses of `listen` do not exist yet. `tls` has the keys for endpoints at `tls/...`.
    """
    named = tls is not None and (mode == "router" or endpoint.startswith("tls/"))
    settings: dict[str, Any] = {
        "id": session_id(_name_in(tls) if named and tls is not None else ""),
        "mode": mode,
        "metadata": {"name": name},
        "scouting": NO_SCOUTING,
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": (
            BLOCKED_SEND_US if mode == "router" else PATIENT_SEND_US
        ),
        "transport/shared_memory/enabled": False,
    }
    if mode == "router":
        if listen_late:
            settings["listen"] = listening_late(endpoint, listen)
        else:
            settings["listen"] = {"endpoints": [endpoint, *listen], "timeout_ms": 0, "exit_on_failure": True}
        settings["connect"] = dialling(connect)
        settings["adminspace"] = READ_ONLY
    else:
        settings["listen"] = {"endpoints": []}
        settings["connect"] = {
            "endpoints": [endpoint],
            "timeout_ms": OPEN_TIMEOUT_MS,
            "exit_on_failure": True,
            "retry": RETRY,
        }
    if tls is not None:
        settings["transport/link/tls"] = tls.settings()
    config = zenoh.Config()
    for key, value in settings.items():
        if isinstance(value, dict) and key in ("scouting", "connect", "listen", "adminspace"):
            for inner, inner_value in value.items():
                config.insert_json5(f"{key}/{inner}", json.dumps(inner_value))
        else:
            config.insert_json5(key, json.dumps(value))
    return config


async def open_client(
    config: zenoh.Config, endpoint: str, tls: Tls | None, stop: asyncio.Event | None, patience: float
) -> zenoh.Session:
    """Open a client's session; retry until `stop`, or for `patience` wall seconds. Raises BusClosed that says why."""
    loop = asyncio.get_running_loop()
    begun = loop.time()
    why, logged, diagnose_at = "", "", begun
    waiting = RepeatedLog(
        lambda seconds: log.warning("waiting for the router at %s for=%.0fs: %s", endpoint, seconds, why)
    )
    try:
        while True:
            try:
                return await open_session(config, endpoint, stop)
            except zenoh.ZError:
                if loop.time() >= diagnose_at:
                    why = await why_not(endpoint, tls) or UNKNOWN
                    late = loop.time() >= begun + STARTS_WITHIN
                    diagnose_at = loop.time() + DIAGNOSE_EVERY if late else begun + STARTS_WITHIN
                    if late and why != logged:
                        logged = why
                        log.warning("waiting for the router at %s: %s", endpoint, why)
            if loop.time() >= begun + patience or (stop is not None and stop.is_set()):
                raise BusClosed(f"no router at {endpoint}: {why}")
            if not waiting.active:
                waiting.begin()
            await asyncio.sleep(0.1)
    finally:
        waiting.end()


async def open_session(config: zenoh.Config, endpoint: str, stop: asyncio.Event | None = None) -> zenoh.Session:
    """Open a session, in a thread that the end of the process does not wait for: Zenoh may never return from it.

    Raises ZError, and BusClosed after `OPEN_PATIENCE`, or `STOP_PATIENCE` once `stop` is set.
    """
    loop = asyncio.get_running_loop()
    opened: asyncio.Future[zenoh.Session] = loop.create_future()

    def settle(session: zenoh.Session | None, error: BaseException | None) -> None:
        if session is not None and not opened.done():
            opened.set_result(session)
        elif session is not None:  # too late
            threading.Thread(target=_close, args=(session,), name=CLOSING, daemon=True).start()
        elif error is not None and not opened.done():
            opened.set_exception(error)

    def open_it() -> None:
        session, error = None, None
        try:
            session = zenoh.open(config)
        except BaseException as failure:  # a panic of Zenoh's is no Exception
            error = failure
        with suppress(RuntimeError):  # the loop has ended
            loop.call_soon_threadsafe(settle, session, error)

    threading.Thread(target=open_it, name=OPENING, daemon=True).start()
    stopping = asyncio.ensure_future((asyncio.Event() if stop is None else stop).wait())
    try:
        either: set[asyncio.Future[Any]] = {opened, stopping}
        await asyncio.wait(either, timeout=OPEN_PATIENCE, return_when=asyncio.FIRST_COMPLETED)
        return await asyncio.wait_for(opened, STOP_PATIENCE)
    except TimeoutError:
        raise BusClosed(f"Zenoh does not open a session for {endpoint}, and does not say why") from None
    finally:
        stopping.cancel()
        opened.cancel()  # a session that opens late is closed


async def close_session(session: zenoh.Session) -> bool:
    """Close a session. Returns whether Zenoh has done it within `CLOSE_PATIENCE`: with a hung router it takes 10 s."""
    loop, closed = asyncio.get_running_loop(), asyncio.Event()

    def close() -> None:
        _close(session)
        with suppress(RuntimeError):  # the loop has ended
            loop.call_soon_threadsafe(closed.set)  # not behind all that waits to be handed over

    threading.Thread(target=close, name=CLOSING, daemon=True).start()
    return await wait_at_most(closed, CLOSE_PATIENCE)


def _close(session: zenoh.Session) -> None:
    try:
        session.close()  # type: ignore[no-untyped-call]
    except BaseException as error:  # a panic of Zenoh's is no Exception
        log.debug("not_closed why=%s", error)


def sessions_under_way() -> list[threading.Thread]:
    """Return the threads of this process in which Zenoh opens or closes a session.

    The interpreter must not end before they do: it would end such a thread within Zenoh, which aborts the process.
    """
    return [one for one in threading.enumerate() if one.name in (OPENING, CLOSING)]


def still_there(threads: Sequence[threading.Thread], seconds: float) -> list[threading.Thread]:
    """Wait for threads to end, at most `seconds` for all of them. Returns those that have not."""
    until = time.monotonic() + seconds
    for one in threads:
        one.join(max(0.0, until - time.monotonic()))
    return [one for one in threads if one.is_alive()]


class _Declared(Protocol):
    def undeclare(self) -> None: ...


class Declaration:
    """Something declared on the bus."""

    def __init__(self, declared: _Declared, withdrawn: Callable[[], None] = lambda: None) -> None:
        self._declared, self._withdrawn = declared, withdrawn

    def close(self) -> None:
        """Withdraw it."""
        self._withdrawn()
        try:
            self._declared.undeclare()
        except zenoh.ZError as error:  # the session is closed already
            log.debug("not_withdrawn why=%s", error)


class KeyCache:
    """The keys of one session, declared to Zenoh when they are used a second time.

    A put on a key that is not declared costs more the more its session has declared: at 100 robots in one process that
    is the greater part of a record's cost. Zenoh finds a declared key by its number.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._declared: dict[str, zenoh.KeyExpr] = {}
        self._once: dict[str, None] = {}
        """The last keys that were used once, the oldest first."""

    def of(self, key: str) -> zenoh.KeyExpr | str:
        """Return the declared key, or the key itself."""
        return self._declared.get(key) or self.used(key) or key

    def used(self, key: str) -> zenoh.KeyExpr | None:
        """Note that a key was used. Returns it if it is declared."""
        if key in self._declared or len(self._declared) >= MOST_KEYS:
            return self._declared.get(key)
        if key not in self._once:
            if len(self._once) >= MOST_KEYS:
                del self._once[next(iter(self._once))]
            self._once[key] = None
            return None
        del self._once[key]
        try:
            declared: zenoh.KeyExpr = self._session.declare_keyexpr(key)
        except zenoh.ZError as error:  # the session is closed, or this is no key
            log.debug("not_declared key=%s why=%s", key, error)
            return None
        self._declared[key] = declared
        if len(self._declared) >= MOST_KEYS:
            log.warning("keys_declared count=%d: records on further keys cost more processor time", MOST_KEYS)
        return declared
