"""Presence and health of the daemons of a fleet, and which daemons of the mission are missing."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from argosy.cli.operator_bus import ANY
from commd.bus.bus import Bus
from schemas.liveness import SILENT_AFTER
from schemas.mission.model import Mission
from schemas.wire import keys
from schemas.wire.health import each_health
from schemas.wire.records import Health, Note

UNDER_WAY = 0.5
"""Wall seconds for which a record of a daemon may arrive after its token has vanished."""
MOST = 5_000
"""Daemons that are observed; further ones are only counted."""
LOOK = 0.05
"""Wall seconds between two checks of whether every daemon has reported."""
FORGET = 60.0
"""Wall seconds without a record after which a daemon that left, and is not in the mission, is forgotten."""

Who = tuple[str, str, str]
"""Fleet, name and daemon."""

Standing = Literal["up", "coming", "silent", "twice", "unclaimed", "missing"]
WELL: frozenset[Standing] = frozenset({"up", "coming"})
MEANING: dict[Standing, str] = {
    "up": "it is on the bus and reports its health",
    "coming": "it is on the bus and has not reported its health yet",
    "silent": "it is on the bus and reports no health: it hangs, or its messages do not arrive",
    "twice": "two daemons have this name: stop one of them",
    "unclaimed": "it reports its health, but its liveliness token does not arrive",
    "missing": "it is in the mission and not on the bus",
}


@dataclass(frozen=True)
class Row:
    """One daemon under one name."""

    name: str
    """The agent, robot, board or client that it serves."""
    daemon: str
    board: str
    """Empty: not known."""
    standing: Standing
    health: Health | None = None
    """Its last health record."""
    age: float | None = None
    """Age of that record in wall seconds."""
    in_mission: bool = True
    fleet: str = ""
    """Where several are shown."""

    @property
    def title(self) -> str:
        """Its name for people."""
        return f"{self.fleet}/{self.name}" if self.fleet else self.name

    @property
    def well(self) -> bool:
        """Whether it is up, or coming up."""
        return self.standing in WELL

    @property
    def notes(self) -> tuple[Note, ...]:
        """Return its presence, if it is not well, and the daemon's own warnings."""
        if self.standing == "missing":
            heard = f"; last heard {self.age:.0f} s ago" if self.age is not None else ""
            return (Note("missing", MEANING["missing"] + heard, value=self.age),)
        standing = () if self.well else (Note(self.standing, MEANING[self.standing]),)
        return standing + (self.health.notes if self.health is not None else ())

    @property
    def now(self) -> Health | None:
        """Its present health; None if it is missing, as its last record no longer holds."""
        return None if self.standing == "missing" else self.health


class FleetStatus:
    """Takes tokens and health records of one fleet or of several; `now` is in wall seconds."""

    def __init__(self, mission: Mission | None, now: Callable[[], float], *, several: bool = False) -> None:
        self.expected: dict[Who, str] = {} if mission is None else expected_of(mission)
        """The daemons of the mission, and the board of each."""
        self.dropped = 0
        """Records and tokens of daemons beyond `MOST`."""
        self._several, self._now, self._forgot = several, now, now()
        self._boots: dict[Who, set[str]] = {}
        self._since: dict[Who, float] = {}
        """When a free name was claimed."""
        self._left: dict[Who, float] = {}
        """When a name became free."""
        self._health: dict[Who, tuple[Health, float]] = {}

    @classmethod
    def of_bus(cls, bus: Bus, fleet: str, mission: Mission | None) -> FleetStatus:
        """Return the status of a fleet, which may be `ANY`, that takes its tokens and health records from the bus."""
        status = cls(mission, asyncio.get_running_loop().time, several=fleet == ANY)

        def heard(key: str, health: Health) -> None:
            status.heard(key, health)

        bus.watch(keys.alive(fleet, "*", "*", "*"), status.token)
        bus.subscribe(keys.health(fleet, "*", "*"), Health, heard)
        return status

    async def settle(self, wait: float) -> None:
        """Wait until every daemon is up, at most `wait` wall seconds."""
        until = self._now() + wait
        while not self.settled and self._now() < until:  # noqa: ASYNC110 - time alone changes it, too
            await asyncio.sleep(LOOK)

    def token(self, key: str, alive: bool) -> None:
        """Take a liveliness token that appeared or vanished."""
        parsed = keys.parse_alive(key)
        if parsed is None:
            return
        who, boot = parsed[:3], parsed[3]
        if not alive:
            boots = self._boots.get(who, set())
            boots.discard(boot)
            if not boots:
                self._since.pop(who, None)
                if self._boots.pop(who, None) is not None:
                    self._left[who] = self._now()
        elif self._room_for(who):
            self._boots.setdefault(who, set()).add(boot)
            self._since.setdefault(who, self._now())

    def heard(self, key: str, health: Health) -> list[tuple[Who, Health]]:
        """Take the health record of a daemon. Returns whom it is about, and the health of each."""
        parsed = keys.parse(key)
        if parsed is None or len(parsed[2]) != 2:
            return []
        fleet, name, (_, daemon) = parsed

        def board_of(agent: str) -> str | None:
            return self.expected.get((fleet, agent, "agentd"))

        found = [((fleet, one, daemon), its) for one, its in each_health(name, health, board_of)]
        for who, its in found:
            if self._room_for(who):
                self._health[who] = (its, self._now())
        return found

    def rows(self) -> list[Row]:
        """Return all daemons: board by board as in the mission, then the others."""
        heard = {who for who, (_, at) in self._health.items() if self._now() - at <= SILENT_AFTER}
        there = self._boots.keys() | heard
        others = sorted(there - self.expected.keys())
        return [
            row for who in (*self.expected, *others) if (row := self._row(who)).in_mission or row.standing != "missing"
        ]

    def holders(self, fleet: str, daemon: str) -> set[str]:
        """Return the names that daemons of this kind hold in a fleet."""
        return {who[1] for who in self._boots if (who[0], who[2]) == (fleet, daemon)}

    def health_of(self, fleet: str, name: str, daemon: str) -> Health | None:
        """Return the last health record of a daemon; None if there is none."""
        return self._health.get((fleet, name, daemon), (None,))[0]

    @property
    def settled(self) -> bool:
        """Whether every daemon of the mission, and every other one, is up."""
        rows = self.rows()
        return bool(rows) and all(row.standing == "up" for row in rows)

    def _row(self, who: Who) -> Row:
        health, at = self._health.get(who, (None, None))
        age = None if at is None else self._now() - at
        fleet, name, daemon = who
        board = self.expected.get(who, name if daemon == "commd" else "")
        known = not self.expected or who in self.expected
        standing = self._standing(who, age)
        return Row(name, daemon, board, standing, health, age, known, fleet if self._several else "")

    def _standing(self, who: Who, age: float | None) -> Standing:
        boots = self._boots.get(who, ())
        tells = age is not None and age <= SILENT_AFTER
        if len(boots) > 1:
            return "twice"
        if not boots:
            told_since = age is not None and self._now() - age > self._left.get(who, -math.inf) + UNDER_WAY
            return "unclaimed" if tells and told_since else "missing"
        if tells or who[2] == "client":  # clients publish no health
            return "up"
        return "coming" if self._now() - self._since[who] <= SILENT_AFTER else "silent"

    def _room_for(self, who: Who) -> bool:
        self._forget()
        known = who in self._boots or who in self._health or who in self.expected
        if known or len(self._boots.keys() | self._health.keys()) < MOST:
            return True
        self.dropped += 1
        return False

    def _forget(self) -> None:
        """Forget daemons that left some time ago: a fleet that creates agents has ever new names."""
        since = self._now() - FORGET
        if self._forgot > since:
            return
        self._forgot = self._now()
        for who in [who for who, (_, at) in self._health.items() if at < since]:
            if who not in self._boots and who not in self.expected:
                del self._health[who]
        for who in [who for who, at in self._left.items() if at < since]:
            if who not in self._health:
                del self._left[who]


def expected_of(mission: Mission) -> dict[Who, str]:
    """Return the daemons of a mission, each with its board; clients are never expected."""
    found: dict[Who, str] = {}
    fleet = mission.fleet
    for board in mission.board_names:
        found[fleet, board, "commd"] = board
        found |= {(fleet, name, "bridged"): board for name in mission.robots_on(board)}
        found |= {(fleet, name, "agentd"): board for name in mission.agents_on(board)}
    return found
