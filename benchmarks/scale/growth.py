"""How the cost grows with the fleet, and at which size what is outgrown: as measured, and beyond that by the fits."""

from __future__ import annotations

from typing import Final

from benchmarks import fits
from benchmarks.bridge.traffic import POSITIONS
from benchmarks.peers import BEAGLEBONE_MB, PI_MB
from benchmarks.results import Origin
from benchmarks.scale.found import IN_TIME, Run

DAEMONS: Final = ("commd", "bridged", "agentd")
FULL: Final = 95.0
"""Per cent of the machine's cores from which on processes wait for one: what they use then is what they get."""
READY: Final = 70.0
"""Per cent of a core from which on who does its work in one thread is often late: what comes has to wait in line."""
BOARDS: Final = {"BeagleBone Black": BEAGLEBONE_MB, "Raspberry Pi 3": PI_MB}
"""MB of memory of boards that the paper flew."""


def easy(row: list[Run]) -> list[Run]:
    """Return the runs by whose cost the growth can be told: those in which cores were left."""
    return [one for one in row if one.busy < FULL]


def first_missed(row: list[Run]) -> Run | None:
    """Return the smallest size that did not get everything in time; none: all did."""
    return next((one for one in row if one.not_served()), None)


def outgrown(row: list[Run], origin: Origin) -> list[str]:
    """Say at which measured size something was outgrown, how the cost grows, and what that means for more UAVs."""
    told = easy(row)
    found = [_measured(row)]
    if len(told) < 2:
        return [*found, "Cores were left at fewer than two sizes: how the cost grows cannot be told from this run."]
    used = ", ".join(str(one.size) for one in told)
    return [
        *found,
        f"By lines of least squares through the sizes at which cores were left ({used}); off: by how much a line or a "
        "power differs from what was measured, at worst:",
        "\n".join(_table(told)),
        _beyond(row, told, origin.cores),
    ]


def _measured(row: list[Run]) -> str:
    limit = first_missed(row)
    sizes = f"{', '.join(str(one.size) for one in row[:-1])} and {row[-1].size}"
    if limit is None:
        return (
            f"**As measured: nothing is outgrown up to {row[-1].size} UAVs** on one link (sizes: {sizes}): all were "
            f"served, no deadline was missed, and {IN_TIME:.0%} of the positions were beliefs before the next one "
            f"was due ({1000 / POSITIONS:.0f} ms)."
        )
    busy = f"{limit.busy:.0f} % of the cores were busy then"
    return (
        f"**As measured: this machine is outgrown at {limit.size} UAVs** on one link, the smallest of the sizes "
        f"{sizes} that did not get everything in time: {'; '.join(limit.not_served())}. {busy}."
    )


def _points(told: list[Run], name: str) -> list[tuple[float, float]]:
    return [(float(one.size), one.use[name].cpu if name in DAEMONS else one.cpu()) for one in told]


def _table(told: list[Run]) -> list[str]:
    rows = ["| | without a UAV, by the line | each UAV | off | grows as | off |", "|---|---|---|---|---|---|"]
    for name in (*DAEMONS, "the three together"):
        points = _points(told, name)
        line = fits.line(points)
        rows.append(
            f"| {name} | {max(0.0, line.base):.2f} % | {line.each:.2f} % | {line.off(points):.0%} | {_power(points)} |"
        )
    points = [(float(one.size), one.pss()) for one in told]
    line = fits.line(points)
    rows.append(
        f"| memory (PSS) | {line.base:.0f} MB | {line.each:.2f} MB | {line.off(points):.0%} | {_power(points)} |"
    )
    return rows


def _power(points: fits.Points) -> str:
    if len(points) < fits.SIZES:
        return f"not told by {len(points)} sizes |"
    growth = fits.power(points)
    return f"{growth} | {growth.off:.0%}"


def _reached(told: list[Run], name: str, per_cent: float) -> float:
    """Return the size at which a daemon takes so much, by the line or, if that is earlier, by the power."""
    points = _points(told, name)
    size = fits.line(points).reaches(per_cent)
    return min(size, fits.power(points).reaches(per_cent)) if len(points) >= fits.SIZES else size


def _beyond(row: list[Run], told: list[Run], cores: int) -> str:
    """Say what would be outgrown first with more UAVs, and that nobody measured that."""
    single = {kind: _reached(told, kind, READY) for kind in DAEMONS}
    first = min(single, key=lambda kind: single[kind])
    board = _reached(told, "the three together", READY * cores)
    held = fits.line([(one.size, one.pss()) for one in told])
    largest = row[-1].size
    items = [
        f"**One process**: `{first}` comes first to {READY:g} % of a core, at {_about(single[first], largest)}: one "
        f"thread does its work, and what comes waits in line from there on. {_REMEDY[first]}",
        f"**One router**: `commd` comes to {READY:g} % of a core, all its threads together, at "
        f"{_about(single['commd'], largest)}.",
        f"**One board** of {cores} cores like these: the three daemons together come to {READY:g} % of them at "
        f"{_about(board, largest)}.",
        "**Memory**: "
        + ", ".join(f"{mb:.0f} MB (a {name}) at {_about(held.reaches(mb), largest)}" for name, mb in BOARDS.items())
        + ", if nothing else were on the board.",
    ]
    return "\n".join(f"- {item}" for item in items)


def _about(size: float, largest: int) -> str:
    if size == float("inf"):
        return "no size: it does not grow"
    return f"{size:.0f} UAVs" if size <= largest else f"about {size:.0f} UAVs by the fit, beyond what was measured"


_REMEDY: Final = {
    "bridged": "More links, each with a bridge of its own, use the other cores.",
    "agentd": "Agents on more boards, or in more than one `agentd` of a board, use the other cores.",
    "commd": "More boards have more routers.",
}
