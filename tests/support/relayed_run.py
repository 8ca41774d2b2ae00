"""`argosy run` with its boards' routers calling one another through relays, so that a test can cut their links.

    python -m tests.support.relayed_run 'tcp/127.0.0.1:9004=tcp/127.0.0.1:9101,...' run MISSION ...

Each router that would call the first endpoint calls the second; the first of several is for the first that calls.
"""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterator
from dataclasses import replace

import argosy.run.command
from argosy.__main__ import main
from argosy.processes.process_table import Place, places
from schemas.mission.model import Mission


def relayed(routers: dict[str, Place], relays: dict[str, Iterator[str]]) -> dict[str, Place]:
    """Return the places of the boards with relays between them."""
    return {
        board: replace(place, connect=tuple(next(relays[one]) for one in place.connect))
        for board, place in routers.items()
    }


if __name__ == "__main__":
    given: dict[str, list[str]] = {}
    for pair in sys.argv[1].split(","):
        target, _, relay = pair.partition("=")
        given.setdefault(target, []).append(relay)

    def places_by_relays(mission: Mission, router: str, taken: Collection[int] = ()) -> dict[str, Place]:
        """Stand in for `argosy.processes.process_table.places`."""
        return relayed(places(mission, router, taken), {target: iter(names) for target, names in given.items()})

    argosy.run.command.places = places_by_relays  # type: ignore[attr-defined]
    sys.exit(main(sys.argv[2:]))
