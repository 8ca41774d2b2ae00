"""Where the time of the loop goes: the stamps of all processes, put together loop by loop."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from benchmarks.processes import BenchmarkFailed


@dataclass(frozen=True)
class Stage:
    """A part of the loop, up to a stamp."""

    stamp: str
    title: str
    who: str
    """`bus` for what Zenoh does between processes."""


STAGES: Final = (
    Stage("ping arrived", "robot's sample on its way to the bridge", "bus"),
    Stage("ping taken", "waits for the bridge's event loop", "bridged"),
    Stage("percept put", "read, translated, told as a percept", "bridged"),
    Stage("percept arrived", "percept on its way to the agent", "bus"),
    Stage("percept taken", "waits for the agent's event loop, decoded", "agentd"),
    Stage("action chosen", "belief, event, plan, action", "agentd"),
    Stage("action kept", "the action is written down", "agentd"),
    Stage("action put", "asked for", "agentd"),
    Stage("action arrived", "action on its way to the bridge", "bus"),
    Stage("action taken", "waits for the bridge's event loop, decoded", "bridged"),
    Stage("driver called", "checked, its id kept", "bridged"),
    Stage("status put", "carried out, success judged, answered", "bridged"),
    Stage("status arrived", "status on its way to the agent", "bus"),
    Stage("end told", "waits for the agent's event loop, decoded", "agentd"),
    Stage("plan goes on", "the intention goes on with its next action", "agentd"),
)
"""In their order; the first begins when the robot puts its sample."""


def read(files: Iterable[Path]) -> dict[str, list[int]]:
    """Return the stamps of some daemons: when each place was passed, ns in order. Raises BenchmarkFailed."""
    found: dict[str, list[int]] = {}
    for file in files:
        try:
            noted = msgspec.json.decode(file.read_bytes(), type=list[tuple[str, int]])
        except (OSError, msgspec.MsgspecError) as error:
            raise BenchmarkFailed(f"no stamps of {file.stem}: {error}") from None
        for where, at in noted:
            found.setdefault(where, []).append(at)
    return {where: sorted(moments) for where, moments in found.items()}


def split(stamps: dict[str, list[int]], windows: Sequence[tuple[int, int]]) -> list[list[float]]:
    """Return how long each stage took, us, loop by loop: one list for each stage.

    `windows` are the begin and end of each loop, ns; in each, the first stamp of a kind after the stage before counts.
    A loop that lacks one is left out. Zenoh may hand a sample over, and its receiver take it, before the call that put
    it has come back: stages that begin before the one before them was over take no time until it was.
    """
    split: list[list[float]] = [[] for _ in STAGES]
    for begun, ended in windows:
        spent, last, passed = list[float](), begun, begun
        for stage in STAGES:
            moment = _first(stamps.get(stage.stamp, []), begun if stage.who == "bus" else passed, ended)
            if moment is None:
                break
            spent.append(max(0, moment - last) / 1000)
            last, passed = max(last, moment), moment
        else:
            for of, one in zip(split, spent, strict=True):
                of.append(one)
    return split


def _first(moments: list[int], begun: int, ended: int) -> int | None:
    place = bisect_left(moments, begun)
    return moments[place] if place < len(moments) and moments[place] <= ended else None
