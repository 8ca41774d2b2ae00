"""How many recorded exchanges the simulated copter answers as recorded: `python -m tests.bridged.index_replay`."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache

from tests.bridged.exchanges import Playback, Record, differences, index, play

KNOWN_DIFFERENCES: dict[tuple[str, str], str] = {}
"""(file, entry): why the simulated copter answers otherwise. What is listed must differ, all else must match."""

FILES = sorted(index())


@cache
def playback_of(name: str) -> Playback:
    """What the simulated vehicles of one file say when they are told what the recorded ones were told."""
    return play(name, index()[name])


@dataclass
class Tally:
    """The exchanges of one file, and how the simulated copter's answers differ."""

    exchanges: list[Record]
    markers: int
    """Further entries, at which nothing was sent and nothing awaited."""
    different: dict[str, list[str]] = field(default_factory=dict)

    @property
    def matched(self) -> int:
        """How many are answered as recorded."""
        return sum(entry["name"] not in self.different for entry in self.exchanges)


@cache
def tally_of(name: str) -> Tally:
    """Compares all entries of one file."""
    entries = index()[name]
    exchanges = [entry for entry in entries if not entry.get("marker")]
    tally = Tally(exchanges, len(entries) - len(exchanges))
    for entry in exchanges:
        if found := differences(playback_of(name), entry):
            tally.different.setdefault(entry["name"], []).extend(f"vehicle {entry.get('sysid')}: {x}" for x in found)
    return tally


def summary() -> str:
    """The line that docs/guides/simulated-copter.md quotes."""
    tallies = [tally_of(name) for name in FILES]
    matched, exchanges = sum(one.matched for one in tallies), sum(len(one.exchanges) for one in tallies)
    markers = sum(one.markers for one in tallies)
    return (
        f"{matched} of {exchanges} exchanges as recorded; the other {markers} of the {exchanges + markers} entries "
        "are markers at which nothing was sent"
    )


def main() -> None:
    """Prints the figures per file, and each difference with its reason."""
    for name in FILES:
        tally = tally_of(name)
        print(f"{name}: {tally.matched} of {len(tally.exchanges)}")
        for entry, found in tally.different.items():
            reason = KNOWN_DIFFERENCES.get((name, entry), "not listed")
            print(f"  {entry}: {'; '.join(found)} ({reason})")
    print(summary())


if __name__ == "__main__":
    main()
