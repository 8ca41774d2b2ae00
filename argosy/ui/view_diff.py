"""What pages show, in parts that have a key each and change one by one; a page is sent what is new since it last asked.

Nothing waits for a page: who is slow gets what holds when it asks again, and of the events the newest that are kept.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

from argosy.ui.view_structs import encoded

KEPT = 3_000
"""Events that are kept for pages that come later."""
AT_FIRST = 600
"""Events that a new page is sent."""
AT_ONCE = 250
"""Events of one message; what is left comes with the next ones."""
OF_MINDS, OF_PLANS = "mind/", "plans/"
"""How the keys of those parts begin that only go to pages that look at that agent."""


@dataclass
class Seen:
    """What one page has."""

    turn: int = 0
    parts: set[str] = field(default_factory=set)
    event: int = 0
    """Number of the newest event that it has."""
    begun: bool = False


class Shown:
    """The parts that pages show, as JSON, and the turn in which each was last changed."""

    def __init__(self, at_first: Callable[[], object] = dict) -> None:
        """`at_first` returns what a page gets at its beginning and at that of a run: the tracks that were flown."""
        self.turn = 0
        self._at_first, self._run_began = at_first, 1
        self.parts: dict[str, tuple[int, bytes]] = {}
        self.events: deque[tuple[int, bytes]] = deque(maxlen=KEPT)
        """The newest events by number, which counts up from 1."""

    def begin_run(self) -> None:
        """What was flown before is over: pages get the tracks anew, with what is shown next."""
        self._run_began = self.turn + 1

    def show(self, parts: Mapping[str, object], events: Sequence[object] = ()) -> None:
        """Take over what holds now: parts that are not among them are gone."""
        self.turn += 1
        for key in self.parts.keys() - parts.keys():
            del self.parts[key]
        for key, part in parts.items():
            data = encoded(part)
            if key not in self.parts or self.parts[key][1] != data:
                self.parts[key] = (self.turn, data)
        number = self.events[-1][0] if self.events else 0
        for event in events:
            number += 1
            self.events.append((number, encoded(event)))

    def add(self, parts: Mapping[str, object]) -> None:
        """Take over some parts; the others stay as they are."""
        self.turn += 1
        for key, part in parts.items():
            self.parts[key] = (self.turn, encoded(part))

    def news(self, seen: Seen, looks_at: Collection[str], now: float) -> bytes:
        """Return a message with what is new for a page, as JSON, and note that it has it. `now` is Unix time."""
        changed, wanted = list[bytes](), set[str]()
        for key, (turn, data) in self.parts.items():
            if key.startswith((OF_MINDS, OF_PLANS)) and key.partition("/")[2] not in looks_at:
                continue
            wanted.add(key)
            if turn > seen.turn or key not in seen.parts:
                changed.append(encoded(key) + b":" + data)
        fields = [b'"now":' + encoded(round(now, 3))]
        fields += [b'"tracks":' + encoded(self._at_first())] if seen.turn < self._run_began else []
        gone = encoded(sorted(seen.parts - wanted)) if seen.parts - wanted else b""
        events, left_out = self._events(seen)
        seen.turn, seen.parts = self.turn, wanted
        fields += [b'"set":{' + b",".join(changed) + b"}"] if changed else []
        fields += [b'"gone":' + gone] if gone else []
        fields += [b'"events":[' + b",".join(events) + b"]"] if events else []
        fields += [b'"left_out":' + encoded(left_out)] if left_out else []
        return b"{" + b",".join(fields) + b"}"

    def _events(self, seen: Seen) -> tuple[list[bytes], int]:
        if not self.events:
            seen.begun = True
            return [], 0
        newest, oldest = self.events[-1][0], self.events[0][0]
        if not seen.begun:
            seen.begun, seen.event = True, max(seen.event, newest - AT_FIRST, oldest - 1)
        left_out = max(0, oldest - 1 - seen.event)
        first = max(seen.event + 1, oldest)
        some = [data for _, data in list(self.events)[first - oldest : first - oldest + AT_ONCE]]
        seen.event = first - 1 + len(some)
        return some, left_out
