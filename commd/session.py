"""Zenoh sessions as Argosy opens them (design section 7, every value measured)."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Sequence
from typing import Any, Literal

import zenoh

from commd.tls import Tls

LEASE_MS = 2_000
"""A peer that says nothing for so long is gone: a hung or cut-off daemon shows within 2 s."""
RETRY_MS = 300
BLOCKED_SEND_US = 300_000
"""A full send queue blocks at most so long before the transport is closed; one hung reader must not stop the others."""
OPEN_TIMEOUT_MS = 1_000
"""One attempt to reach the router. Attempts repeat, so that a stop is noticed in between."""


OPENING, LEAVING = "opening", "leaving"
"""Names of the threads in which sessions are opened and closed: Zenoh may be long about both."""
RETRY = {"period_init_ms": RETRY_MS, "period_max_ms": RETRY_MS, "period_increase_factor": 1}
NOBODY_IS_SOUGHT = {"delay": 0, "multicast": {"enabled": False}, "gossip": {"enabled": False}}
READ_ONLY = {"enabled": True, "permissions": {"read": True, "write": False}}


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
    settings: dict[str, Any] = {
        "mode": mode,
        "metadata": {"name": name},
        "scouting": NOBODY_IS_SOUGHT,
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": BLOCKED_SEND_US,
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
