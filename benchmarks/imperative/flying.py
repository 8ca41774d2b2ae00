"""What scout and rescuers alike know of flying, and of talking to one another.

Nothing is tried again here: a step that fails raises, and the program decides anew by what it perceives.
"""

import asyncio
from math import cos, hypot, radians

from commd.client import Unanswered
from schemas.wire.terms import Structure

METRES_PER_DEGREE = 111320


class Failed(Exception):
    """An action or a wait has failed, and why."""


def metres(here, there):
    north, east = there[0] - here[0], there[1] - here[1]
    return METRES_PER_DEGREE * hypot(north, east * cos(radians(here[0])))


class Flyer:
    def __init__(self, me, height):
        self.me, self.seen, self.height = me, me.percepts(), height
        self.news = asyncio.Event()

    # What is perceived.

    def percept(self, name):
        """The parameters of a percept, which is to be there."""
        for parameters in self.seen.of(name):
            return parameters
        raise Failed(f"no {name} is perceived")

    def perceives(self, *others):
        """Whether all is there that decisions are made by: after a start, and whenever the bridge was away."""
        names = "state", "altitude", "global_pos", "battery", *others
        return all(map(self.seen.of, names)) and self.percept("state")[1]

    def armed(self):
        return self.percept("state")[2]

    def battery(self):
        return self.percept("battery")[2]

    async def until(self, condition, seconds):
        """Wait for what is perceived, some seconds of the mission at most."""
        return await self.seen.until(lambda _: condition(), self.me.wall(seconds))

    # What is done.

    async def act(self, action, *parameters):
        status = await self.me.perform(action, *parameters)
        if not status.result:
            raise Failed(status.reason)

    async def at(self, latitude, longitude):
        await self.aloft()
        await self.act("goto", latitude, longitude, self.height)

    async def aloft(self):
        aloft = self.armed() and self.percept("altitude")[0] > 2
        if not aloft or self.percept("state")[0] != "GUIDED":  # on its way home, or held by the bridge
            await self.act("set_mode", "GUIDED")
        if not aloft:
            if not self.armed():
                await self.act("arm_motors", True)
            await self.act("takeoff", self.height)

    # What is said.

    async def tell(self, receivers, performative, functor, *values):
        for receiver in receivers:
            await self.me.send(receiver, performative, Structure(functor, values))

    async def ask(self, receiver, functor, victim, seconds):
        """Ask somebody something about a victim; None if there is no answer in time."""
        try:
            return await self.me.ask(receiver, Structure(functor, (victim,)), patience=self.me.wall(seconds))
        except Unanswered:
            return None

    async def listen(self):
        """Handle one message after the other: what `heard` does for one is never interrupted by another."""
        async for message in self.me.messages():
            fact = message.content
            answer = await self.heard(message.sender, message.performative, fact.functor, *fact.args)
            if message.performative == "askOne":
                await self.me.send(message.sender, "tell", answer, in_reply_to=message.id)
            self.news.set()
