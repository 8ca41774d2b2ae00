"""Zenoh sessions as Argosy opens them (design section 7, every value measured)."""

from __future__ import annotations

import hashlib
import json
import os
import threading
import time
from collections.abc import Iterable, Sequence
from typing import Any, Literal

import zenoh

from commd.bus.tls import Tls, identity_in
from schemas.files.findings import Findings

LEASE_MS = 2_000
"""A peer that says nothing for so long is gone: a hung or cut-off daemon shows within 2 s."""
RETRY_MS = 300
BLOCKED_SEND_US = 300_000
"""A router's full send queue blocks at most so long before that link is closed: a hung reader must not stop others."""
PATIENT_SEND_US = 1_000_000
"""As `BLOCKED_SEND_US`, of a daemon, which has one link: it does not give up its router while that waits for others."""
OPEN_TIMEOUT_MS = 1_000
"""One attempt to reach the router. Attempts repeat, so that a stop is noticed in between."""


OPENING, LEAVING = "opening", "leaving"
"""Names of the threads in which sessions are opened and closed: Zenoh may be long about both."""
RETRY = {"period_init_ms": RETRY_MS, "period_max_ms": RETRY_MS, "period_increase_factor": 1}
NOBODY_IS_SOUGHT = {"delay": 0, "multicast": {"enabled": False}, "gossip": {"enabled": False}}
READ_ONLY = {"enabled": True, "permissions": {"read": True, "write": False}}


def session_id(name: str = "") -> str:
    """Return a new Zenoh id for a session of the machine whose certificate has this name; "" = by a board's socket.

    A router refuses the second of two sessions with one id, and all ids can be read by everybody. So they say whose
    they are, and a board's router cuts off who comes with another's (`commd.router.admission`).
    """
    return _begins(name) + os.urandom(9).hex() + "f"


def set_id(config: zenoh.Config, board: str) -> None:
    """Give the router of a board an id that says whose it is."""
    config.insert_json5("id", json.dumps(session_id(board)))


def owner_of(zid: str, names: Iterable[str]) -> str | None:
    """Return which of the machines, or "" for a daemon at its board's socket, an id is for; None if for neither."""
    return next((name for name in ("", *names) if zid.startswith(_begins(name))), None)


def _name_in(tls: Tls) -> str:
    """Return the name in a certificate; of one that nobody would accept, none that any machine has."""
    try:
        return identity_in(tls).name
    except Findings:
        return "?"


def _begins(name: str) -> str:
    return "a" + hashlib.sha256(f"argosy session of {name}".encode()).hexdigest()[:12]


def listening_late(endpoint: str, listen: Sequence[str]) -> dict[str, Any]:
    """Return Zenoh's `listen` of a router that has to have its own endpoint, and the others as soon as it can."""
    endpoints = [f"{endpoint}#exit_on_failure=true", *listen]
    return {"endpoints": endpoints, "timeout_ms": -1, "exit_on_failure": False, "retry": RETRY}


def dialling(connect: Sequence[str]) -> dict[str, Any]:
    """Return Zenoh's `connect` of a router that dials others again and again, and waits for none."""
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

    A router listens at `listen` besides its endpoint and dials the routers at `connect`, again and again for as long as
    it lives. With `listen_late` it opens although `listen` cannot be had yet, and listens there as soon as it can.
    What is at `tls/...` is reached, and listened at, by `tls`.
    """
    named = tls is not None and (mode == "router" or endpoint.startswith("tls/"))
    settings: dict[str, Any] = {
        "id": session_id(_name_in(tls) if named and tls is not None else ""),
        "mode": mode,
        "metadata": {"name": name},
        "scouting": NOBODY_IS_SOUGHT,
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


def sessions_under_way() -> list[threading.Thread]:
    """Return the threads of this process in which Zenoh opens or closes a session.

    While one is left, the interpreter may not end: it would end that thread within Zenoh, which aborts the process.
    """
    return [one for one in threading.enumerate() if one.name in (OPENING, LEAVING)]


def still_there(threads: Sequence[threading.Thread], seconds: float) -> list[threading.Thread]:
    """Wait for threads to end, at most so many seconds for all of them. Returns those that have not."""
    until = time.monotonic() + seconds
    for one in threads:
        one.join(max(0.0, until - time.monotonic()))
    return [one for one in threads if one.is_alive()]
