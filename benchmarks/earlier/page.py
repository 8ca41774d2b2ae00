"""The list of docs/measurements/benchmarks.md: what was slow, what was done, and both figures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from benchmarks.results import Origin

if TYPE_CHECKING:
    from benchmarks.earlier.part import Figures


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the list."""
    pairs = ", ".join(f"{name} {count}" for name, count in figures.pairs.items())
    head = (
        f"Then is {figures.revision}, the last revision before the first measurement; now is the one that is named "
        "here. The same probes (`benchmarks/earlier/probes.py`) ran in both, in turn; means of their runs (pairs: "
        f"{pairs})."
    )
    return {"earlier": "\n\n".join([origin.line(), head, "\n".join(_items(figures))])}


def _items(figures: Figures) -> list[str]:
    fleet, loop, percepts, crowd = (figures.probes[name] for name in ("fleet", "loop", "percepts", "crowd"))
    return [
        "1. **A record of a crowd, at its sender.** What Zenoh does for a put on a key that is not declared is a walk "
        f"through all that its session has declared: with what {fleet.now['agents']:,.0f} agents serve, "
        f"{fleet.then['put']:.0f} µs of processor time for a record, now **{fleet.now['put']:.0f} µs**. A session "
        "declares each key that it uses a second time (`commd/bus/key_cache.py`; ef5a668, 69763c6, 90e42bd).",
        "2. **The same record, at the router.** Not mended: the router walks as well, heard or not: "
        f"{fleet.then['router']:.0f} µs of its processor time then, **{fleet.now['router']:.0f} µs** now. "
        "It is taken to be what ends the talk of a crowd ([scaling.md](scaling.md#many-agents-in-one-daemon)). "
        "A *declared publisher*, whose "
        "route a router keeps, takes it away; but a session that puts by one sends nothing until it has been told of a "
        "listener, and whether the access rules of a secured fleet let it be told of each was not shown. A record of "
        "health that does not come stops a robot, so this was left.",
        "3. **An action, from the robot's word to the robot's next deed.** "
        f"{loop.then['kept']:,.0f} µs then, **{loop.now['kept']:,.0f} µs** now; the bare exchanges in it took "
        f"{loop.then['kept_bare']:,.0f} and {loop.now['kept_bare']:,.0f} µs. The bridge answered its asker last, after "
        "log, observers and disk (5448e7f); an action was written down in a turn of its own, with more than it needs "
        "(8684919); each reply had a timer of its own (1037dd3). Without what it takes to keep the agent on disk: "
        f"{loop.then['fresh']:,.0f} µs then, {loop.now['fresh']:,.0f} µs now.",
        f"4. **A percept, in the agent.** {percepts.then['agentd']:.0f} µs of processor time for one that changes "
        f"then, **{percepts.now['agentd']:.0f} µs** now; in the bridge {percepts.then['bridged']:.0f} and "
        f"{percepts.now['bridged']:.0f} µs. Each woke a task and set a timer (6446a99), numbers and words were weighed "
        "as if they could be terms of any kind (9654dc5), and a union of types was made for each value (33bd4d2).",
        f"5. **The start of a crowd.** An agentd with {crowd.now['agents']:,.0f} agents serves after "
        f"{crowd.then['start']:.1f} s then, **{crowd.now['start']:.1f} s** now ({crowd.then['agentd']:.1f} and "
        f"{crowd.now['agentd']:.1f} s of its processor time). Its agents ask commd in turn, so that none is turned "
        "away (9bb4493): not made faster otherwise. What it takes is each agent's own: its claim, its "
        "checkpoint, and what it declares, which costs the more the more is declared.",
    ]
