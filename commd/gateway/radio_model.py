"""A model of the radio between robots: who hears whom, what is lost, and how long it takes (mission field `radio`).

It is below the retries of mail: lost batches are sent again, as over a real radio. The model is pure: positions, sizes
and seconds go in, fates come out, and equal seeds lose equal transmissions of each pair, whatever other pairs do.
`RadioAir` connects it to a `commd`: it subscribes to the positions of the simulated robots and lets time pass.
"""

from __future__ import annotations

import asyncio
import logging
import math
import random
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from commd.bus.bus import Bus
from commd.bus.errors import BusClosed
from schemas import geo
from schemas.geo import Position
from schemas.mission.model import Mission, Radio
from schemas.wire import keys
from schemas.wire.records import Health, Note, Perception
from schemas.wire.terms import to_float

log = logging.getLogger("radio")

POSITION = "global_pos"
"""The percept of a robot's position: degrees of latitude and longitude."""
ASK_EVERY = 5.0
"""Wall seconds between two queries of all positions: a percept may be lost, and an unchanged one is not published
again."""


@dataclass(frozen=True)
class Fate:
    """The fate of a transmission."""

    arrives: float
    """When it ends, in seconds of the caller's clock."""
    lost: bool
    """By chance; the range is checked when it ends."""


class RadioModel:
    """One radio per robot; a channel for each direction of a pair."""

    def __init__(self, radio: Radio, salt: str = "") -> None:
        """`salt` distinguishes models with one seed at different boards."""
        self._radio, self._salt = radio, salt
        self._positions: dict[str, Position] = {}
        self._chances: dict[tuple[str, str], random.Random] = {}
        self._free_at: dict[tuple[str, str], float] = {}

    def place(self, robot: str, position: Position) -> None:
        """Set the position of a robot."""
        self._positions[robot] = position

    def distance(self, one: str, other: str) -> float | None:
        """Return the metres over ground between two robots; None while a position is unknown."""
        here, there = self._positions.get(one), self._positions.get(other)
        return None if here is None or there is None else geo.distance(here, there)

    def in_range(self, one: str, other: str) -> bool:
        """Return whether two robots are within range; True while a position is unknown."""
        distance = self.distance(one, other)
        return self._radio.range is None or distance is None or distance <= self._radio.range

    def send(self, now: float, sender: str, receiver: str, size: int) -> Fate:
        """Send `size` bytes at `now`, after earlier transmissions on this channel."""
        line = (sender, receiver)
        chance = self._chances.get(line)
        if chance is None:
            chance = self._chances[line] = random.Random(f"{self._radio.seed}/{self._salt}/{sender}/{receiver}")
        length = 0.0 if self._radio.bandwidth is None else size * 8 / self._radio.bandwidth
        sent = max(now, self._free_at.get(line, now)) + length
        self._free_at[line] = sent
        return Fate(sent + self._radio.delay, chance.random() < self._radio.loss)


class RadioAir:
    """The radio of one board's `commd`: agents use the radio of their robots.

    An agent without a robot is a station without limit of range, but with loss, delay and bandwidth. Agents of one
    robot need no radio.
    """

    def __init__(self, bus: Bus, mission: Mission, radio: Radio, board: str) -> None:
        self.counters: Counter[str] = Counter()
        """radio_sent, radio_lost, radio_out_of_range: transmissions so far."""
        self._bus, self._robots = bus, robots_of(mission)
        self._radio, self._model = radio, RadioModel(radio, board)
        for name, robot in mission.robots.items():
            if robot.simulate is not None and robot.simulate.home is not None:
                self._model.place(name, robot.simulate.home[:2])
        self._where = keys.percept(bus.fleet, "*", POSITION)
        bus.subscribe(self._where, Perception, self._heard)
        log.warning("mail between boards is degraded on purpose, as the mission declares: %s", described(radio))

    async def run(self) -> None:
        """Query the positions of the robots, for ever."""
        while True:
            try:
                await self._bus.ask_all(self._where, Perception, ASK_EVERY, self._heard)
            except BusClosed as closed:
                log.debug("positions_unknown why=%s", closed)
            await asyncio.sleep(ASK_EVERY)

    def health(self) -> Health:
        """Return the counts of transmissions for the daemon's health."""
        return Health(
            counters={name: float(count) for name, count in sorted(self.counters.items())},
            notes=(Note("radio_degraded", f"mail between boards is degraded as declared: {described(self._radio)}"),),
        )

    async def carries(self, sender: str, receiver: str, size: int) -> bool:
        """Wait for one transmission of `size` bytes. Returns whether it arrived."""
        here, there = self._robots.get(sender, sender), self._robots.get(receiver, receiver)
        if here == there:
            return True
        loop = asyncio.get_running_loop()
        fate = self._model.send(loop.time(), here, there, size)
        await asyncio.sleep(max(0.0, fate.arrives - loop.time()))
        self.counters["radio_sent"] += 1
        if not self._model.in_range(here, there):
            self.counters["radio_out_of_range"] += 1
            return False
        self.counters["radio_lost"] += fate.lost
        return not fate.lost

    def _heard(self, key: str, perception: Perception) -> None:
        parsed = keys.parse(key)
        robot = self._robots.get(parsed[1]) if parsed is not None else None
        if robot is None or perception.update == "remove":
            return  # a robot without a bridge keeps its position
        position = [to_float(term) for term in perception.parameters[:2]]
        match position:
            case [float(latitude), float(longitude)] if math.isfinite(latitude) and math.isfinite(longitude):
                self._model.place(robot, (latitude, longitude))


def robots_of(mission: Mission) -> Mapping[str, str]:
    """Return the robot of each agent and client that has one."""
    return {agent: robot for robot in mission.robots for agent in mission.agents_of(robot)}


def described(radio: Radio) -> str:
    """Return the limits of the radio, for people."""
    parts = [f"range {radio.range}"] if radio.range is not None else []
    parts += [f"loss {radio.loss:g}"] if radio.loss else []
    parts += [f"delay {radio.delay}"] if radio.delay else []
    parts += [f"bandwidth {radio.bandwidth:g} bit/s"] if radio.bandwidth is not None else []
    return ", ".join(parts) or "nothing"
