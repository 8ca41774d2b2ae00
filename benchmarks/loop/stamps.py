"""When a daemon passed where: `python -m benchmarks.loop.stamps FILE DAEMON ARGUMENTS` runs it with stamps.

The daemon's own main runs, with some of its functions wrapped by others that note the moment (ns, monotonic: one clock
for all processes of the machine) and call them. The product has no stamps of its own. What was noted is written to FILE
when the daemon has ended.
"""

from __future__ import annotations

import runpy
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, cast

import msgspec
import zenoh

MOST: Final = 1_000_000
"""Stamps that are kept."""
_noted: list[tuple[str, int]] = []


def note(where: str) -> None:
    """Note that somebody is here now."""
    if len(_noted) < MOST:
        _noted.append((where, time.monotonic_ns()))


def before(owner: Any, name: str, where: str, only: Callable[..., bool]) -> None:
    """Note each call of `owner.name` as it begins; `only` is asked with its arguments whether it counts."""
    inner = getattr(owner, name)

    def stamped(*arguments: Any, **named: Any) -> Any:
        if only(*arguments, **named):
            note(where)
        return inner(*arguments, **named)

    setattr(owner, name, stamped)


def _arrival(item: Any) -> str:
    """Return what of the loop has come in, empty if it is none of it."""
    if isinstance(item, zenoh.Sample):
        key = str(item.key_expr)
        return "ping arrived" if key.endswith("robot/ping") else "percept arrived" if "/percept/" in key else ""
    if isinstance(item, zenoh.Query):
        return "action arrived" if str(item.key_expr).endswith("/pong") else ""
    if isinstance(item, zenoh.Reply) and item.ok is not None and str(item.ok.key_expr).endswith("/pong"):
        return "status arrived" if b"succeeded" in item.ok.payload.to_bytes() else ""
    return ""


def _stamp_arrivals() -> None:
    """What Zenoh's threads hand in, at the moment when they do."""
    made: Any = zenoh.handlers.Callback

    def make(callback: Callable[[Any], Any], *arguments: Any, **named: Any) -> Any:
        def stamped(item: Any) -> Any:
            if where := _arrival(item):
                note(where)
            return callback(item)

        return made(stamped, *arguments, **named)

    zenoh.handlers.Callback = make  # type: ignore[assignment, misc]


class _Session:
    """A session whose puts and queries are noted when Zenoh has taken them."""

    def __init__(self, session: Any) -> None:
        self._session = session

    def __getattr__(self, name: str) -> Any:
        return getattr(self._session, name)

    def put(self, key: Any, *arguments: Any, **named: Any) -> None:
        """Put, and note it."""
        self._session.put(key, *arguments, **named)
        if str(key).endswith("/percept/ping"):
            note("percept put")

    def get(self, key: Any, *arguments: Any, **named: Any) -> Any:
        """Ask, and note it."""
        result = self._session.get(key, *arguments, **named)
        if str(key).endswith("/pong"):
            note("action put")
        return result


def _stamp_session() -> None:
    from commd.bus import bus

    made = bus.Bus.__init__

    def init(self: Any, session: Any, **named: Any) -> None:
        made(self, cast(zenoh.Session, _Session(session)), **named)

    bus.Bus.__init__ = init  # type: ignore[method-assign]


def _stamp_the_bridge() -> None:
    from bridged.bridge.action_server import ActionServer
    from bridged.bridge.composite_driver import CompositeDriver
    from bridged.drivers.zenoh.subscriptions import Sources
    from commd.bus.bus import Bus

    before(Sources, "_take", "ping taken", lambda _, name, sample: name == "ping")
    before(ActionServer, "ask", "action taken", lambda _, agent, name, *more: name == "pong")
    before(CompositeDriver, "perform", "driver called", lambda _, name, *more: name == "pong")
    reply = Bus._reply

    def replied(self: Any, query: Any, key: str, record: Any) -> None:
        reply(self, query, key, record)
        if getattr(record, "final", False) and record.name == "pong":
            note("status put")

    Bus._reply = replied  # type: ignore[method-assign]


def _stamp_the_agent() -> None:
    from agentd.mind.data.effects import PerformAction
    from agentd.persistence.checkpointer import Checkpointer
    from agentd.runtime.agent_host import AgentHost
    from commd.client.percept_sync import PerceptSync

    def performs(name: str) -> Callable[[Any, Any], bool]:
        return lambda _, effect: isinstance(effect, PerformAction) and effect.name == name

    before(PerceptSync, "_heard", "percept taken", lambda _, key, perception: perception.name == "ping")
    before(AgentHost, "_carry_out", "action chosen", performs("pong"))
    before(Checkpointer, "_written", "action kept", lambda *_, **__: True)
    before(AgentHost, "_done", "end told", lambda *_: True)
    before(AgentHost, "_carry_out", "plan goes on", performs("seen"))


def main(file: str, daemon: str, arguments: list[str]) -> None:
    """Run a daemon with stamps."""
    _stamp_arrivals()
    _stamp_session()
    {"bridged": _stamp_the_bridge, "agentd": _stamp_the_agent}[daemon]()
    sys.argv = [daemon, *arguments]
    try:
        runpy.run_module(daemon, run_name="__main__", alter_sys=True)
    finally:
        Path(file).write_bytes(msgspec.json.encode(_noted))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], sys.argv[3:])
