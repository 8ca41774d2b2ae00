"""What happens to boards while their agents write to one another: kills, cuts, a full disk, each at its time."""

import heapq
import random
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

from tests.boards.disk import Disk
from tests.boards.fleet import Fleet, Kind

SAME_DAEMON = 8.0
"""Seconds between two kills of one daemon, so that each hits a living one."""
BACK = (0.2, 4.0)
"""Seconds after which a killed daemon is started again."""
RESTART = 1.0
"""Seconds after which a daemon that ended by itself is started again, as a supervisor would."""


@dataclass(frozen=True, order=True)
class Trouble:
    """Something that happens at a time, in seconds, for so many seconds."""

    at: float
    what: Literal["kill commd", "kill agentd", "unplug", "down", "part", "full disk"]
    board: str
    seconds: float

    def __str__(self) -> str:
        return f"{self.at:.0f} s: {self.what} {self.board} for {self.seconds:.1f} s"


def plan(
    boards: Sequence[str], seconds: float, kills: int, cuts: Sequence[float], full: tuple[str, float] | None, seed: int
) -> list[Trouble]:
    """Return what is to happen within so many seconds: kills at random, cuts of these lengths, a full disk."""
    chance = random.Random(seed)
    made: list[Trouble] = []
    if full is not None:
        made.append(Trouble(chance.uniform(0.1, 0.9) * (seconds - full[1]), "full disk", *full))
    slots = seconds / max(len(cuts), 1)
    for number, length in enumerate(cuts):  # one after another, so that each is a cut of its own length
        how: Literal["unplug", "down", "part"] = ("unplug", "down", "part")[number % 3]
        begins = number * slots + chance.uniform(0, max(0.0, slots - length - 5.0))
        made.append(Trouble(begins, how, chance.choice(list(boards)), length))
    killed: dict[tuple[str, str], list[float]] = {}
    while kills:
        kind: Literal["kill commd", "kill agentd"] = chance.choice(("kill commd", "kill agentd"))
        board, at = chance.choice(list(boards)), chance.uniform(0, seconds)
        before = killed.setdefault((kind, board), [])
        if all(abs(at - other) > SAME_DAEMON for other in before):
            before.append(at)
            made.append(Trouble(at, kind, board, chance.uniform(*BACK)))
            kills -= 1
    return sorted(made)


class Course:
    """Lets troubles happen to a fleet; a daemon that ends by itself is noted and started again, as by a supervisor."""

    def __init__(
        self, fleet: Fleet, troubles: Sequence[Trouble], disks: dict[str, Disk], say: Callable[[str], None]
    ) -> None:
        self._fleet, self._disks, self._say = fleet, disks, say
        self._begun = time.monotonic()
        self._agenda: list[tuple[float, int, Callable[[], None]]] = []
        self._order = 0
        self._down: set[tuple[str, Kind]] = set()
        """Daemons that are to be started again at their time."""
        self.happened: Counter[str] = Counter()
        self.ended_by_themselves: list[str] = []
        for trouble in troubles:
            self._at(trouble.at, partial(self._begin, trouble))

    @property
    def seconds(self) -> float:
        """Seconds since it began."""
        return time.monotonic() - self._begun

    @property
    def over(self) -> bool:
        return not self._agenda

    def step(self) -> None:
        """Do what is due."""
        while self._agenda and self._agenda[0][0] <= self.seconds:
            heapq.heappop(self._agenda)[2]()
        self._supervise()

    def _at(self, seconds: float, action: Callable[[], None]) -> None:
        self._order += 1
        heapq.heappush(self._agenda, (seconds, self._order, action))

    def _begin(self, trouble: Trouble) -> None:
        board, network = trouble.board, self._fleet.network
        until = self.seconds + trouble.seconds
        self._say(str(trouble))
        self.happened[trouble.what] += 1
        match trouble.what:
            case "kill commd" | "kill agentd":
                self._kill(board, "commd" if trouble.what == "kill commd" else "agentd", until)
            case "unplug":
                network.unplug(board)
                self._at(until, lambda: network.plug(board))
            case "down":
                network.down(board)
                self._at(until, lambda: network.up(board))
            case "part":
                other = next(one for one in self._fleet.boards if one != board)
                network.part(board, other)
                self._at(until, lambda: network.join(board, other))
            case "full disk":
                self._disks[board].fill()
                self._at(until, self._disks[board].free)

    def _kill(self, board: str, kind: Kind, until: float) -> None:
        self._down.add((board, kind))
        self._fleet.kill(board, kind)
        self._at(until, partial(self._back, board, kind))

    def _back(self, board: str, kind: Kind) -> None:
        if (board, kind) in self._down:
            self._fleet.start(board, kind)
            self._down.discard((board, kind))

    def _supervise(self) -> None:
        for (board, kind), daemon in list(self._fleet.running.items()):
            code = daemon.process.poll()
            if code is None or (board, kind) in self._down:
                continue
            note = f"{self.seconds:.0f} s: {kind} of {board} ended by itself, exit {code}: {daemon.lines[-3:]}"
            self.ended_by_themselves.append(note)
            self._say(note)
            self._down.add((board, kind))
            self._at(self.seconds + RESTART, partial(self._back, board, kind))
