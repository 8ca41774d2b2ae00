"""Which keys are heard, and by which sessions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import zenoh

from argosy.cli.fleet_bus import FleetBus
from argosy.recording.file.write_queue import WriteQueue
from commd.bus.bus import Bus
from schemas.files.findings import Finding, Findings
from schemas.wire import keys


def wanted_keys(fleet: str, only: Iterable[str]) -> list[str]:
    """Return key expressions as they are on the bus: those that do not begin with `argosy/` are of the fleet.

    Raises Findings for what is no key expression.
    """
    found = []
    for text in only:
        key = text if text == keys.ROOT or text.startswith(f"{keys.ROOT}/") else f"{keys.ROOT}/{fleet}/{text}"
        try:
            found.append(str(zenoh.KeyExpr.autocanonize(key)))
        except zenoh.ZError:
            told = "expected a key expression such as `uav1/**` or `*/percept/**`"
            raise Findings([Finding("--only", 0, 0, f"`{text}`: {told}")]) from None
    return found


def hear(bus: Bus, fleet: str, only: Sequence[str], write_queue: WriteQueue) -> None:
    """Let all that is put be taken in, at each board where there are several sessions."""
    everything = f"{keys.ROOT}/**" if fleet == "*" else f"{keys.ROOT}/{fleet}/**"
    for key in only or (everything,):
        if isinstance(bus, FleetBus):
            bus.boards.at_each(lambda board, one, key=key: one.raw.tap(key, write_queue.sample))  # type: ignore[misc]
        else:
            bus.raw.tap(key, write_queue.sample)
