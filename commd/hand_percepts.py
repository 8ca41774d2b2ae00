"""Percepts that people put by hand, beside those of the bridge, where the mission says `inject: true`.

They hold until they are taken away by hand: no repair, digest or end of the bridge concerns them.
"""

from __future__ import annotations

import logging
import re
from collections import Counter
from collections.abc import Callable

from msgspec.structs import replace

from commd.bus import Bus
from schemas import keys
from schemas.percepts import PerceptSet, differences
from schemas.records import Perception

MOST = 1000
"""Percepts by hand that an agent has at once; further ones are refused and counted."""
_NAME = re.compile(r"[a-z][A-Za-z0-9_]*", re.ASCII)
_LIFE = "hand"
log = logging.getLogger("percepts")


class HandPercepts:
    """What one agent perceives by hand."""

    def __init__(self, agent: str, allowed: bool, counters: Counter[str]) -> None:
        """`allowed`: the mission says `inject: true`; `counters` gets what is taken, ignored and refused."""
        self.percepts = PerceptSet()
        self._agent, self._allowed, self._counters = agent, allowed, counters

    def take(self, key: str, perception: Perception) -> list[Perception]:
        """Take in what was put on `key`. Returns what has changed by it, removals first."""
        name = key.rpartition("/")[2]
        if not self._allowed:
            self._counters["by_hand_ignored"] += 1
            if self._counters["by_hand_ignored"] == 1:
                why = "as further ones are: the mission does not say `inject: true`"
                log.warning("agent=%s a percept `%s` put by hand is ignored, %s", self._agent, name, why)
            return []
        if problem := self._problem(name, perception):
            self._counters["by_hand_refused"] += 1
            count = self._counters["by_hand_refused"]
            if count <= 10 or count % 1000 == 0:
                log.warning("agent=%s percept by hand refused count=%d: %s", self._agent, count, problem)
            return []
        before = self.percepts.present()
        if perception.update == "remove" and not perception.parameters:
            by_arity = {len(one.parameters): one.parameters for one in before if one.name == name}
            for parameters in by_arity.values():
                self._apply(replace(perception, name=name, parameters=parameters, key=()))
        else:
            self._apply(replace(perception, name=name))
        self._counters["by_hand"] += 1
        log.info("agent=%s percept by hand: %s %s", self._agent, perception.update, name)
        return differences(before, self.percepts.present())

    def _apply(self, perception: Perception) -> None:
        """Take in a perception as the next one of a stream of our own, with the rest of its header if it has one."""
        self.percepts.apply(
            replace(perception, header=replace(perception.header, seq=self.percepts.seq + 1, boot=_LIFE))
        )

    def _problem(self, name: str, perception: Perception) -> str:
        if perception.name not in ("", name):
            return f"the key says {name}, the percept says {perception.name}"
        if not _NAME.fullmatch(name):
            return f"expected a name such as `victim`, got `{name}`"
        if perception.update != "remove" and len(self.percepts) >= MOST:
            return f"there are {MOST} already"
        return ""


def hear_by_hand(bus: Bus, agent: str, on_change: Callable[[Perception], None]) -> HandPercepts:
    """Let an agent without a robot perceive what is put by hand, where the mission allows it."""
    by_hand = HandPercepts(agent, True, Counter())

    def heard(key: str, perception: Perception) -> None:
        for change in by_hand.take(key, perception):
            on_change(change)

    bus.subscribe(keys.percept(bus.fleet, agent, "*"), Perception, heard)
    return by_hand
