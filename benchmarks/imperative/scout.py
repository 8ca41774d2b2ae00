"""The scout of a search and rescue (the paper, section 5.2). It sweeps its area in lanes, tells the rescuers of each
victim once, and keeps the book of who is to rescue whom.

Rescuers negotiate among themselves who goes. The book makes sure that two never bring a buoy to the same victim, also
when one of them is cut off on its way: a rescuer drops only with leave that was given over the victim, and a victim
whose rescuer has that leave is nobody else's until that rescuer tells what became of it. Before that it may be promised
to another one at any time. So nobody has to agree about the time.
"""

import asyncio
from dataclasses import dataclass
from math import ceil

from benchmarks.imperative.flying import METRES_PER_DEGREE, Failed, Flyer


@dataclass(eq=False)
class Promise:
    """A victim is promised to a rescuer, which has leave to drop its buoy there when it is cleared."""

    rescuer: str
    cleared: bool = False


class Scout(Flyer):
    def __init__(self, me, area, lane_width, height, rescuers, patience, lease, lost):
        super().__init__(me, height)
        self.area, self.lane_width, self.rescuers = area, lane_width, rescuers
        self.patience, self.lease, self.lost = patience, lease, lost
        self.found, self.rescued, self.book = set(), set(), {}

    def missing(self):
        return self.found - self.rescued

    # The search.

    async def search(self):
        south, west, north, east = self.area
        for lane in range(ceil((north - south) * METRES_PER_DEGREE / self.lane_width)):
            latitude = south + (lane + 0.5) * self.lane_width / METRES_PER_DEGREE
            ends = (east, west) if lane % 2 else (west, east)
            await self.insist(self.fly_lane, lane, latitude, *ends)
        print("swept")
        await self.insist(self.return_home)
        await self.tell(self.rescuers, "tell", "search_over")
        while self.missing():
            self.news.clear()
            await self.news.wait()
        print("all are rescued")

    async def insist(self, step, *arguments):
        """Do a step until it succeeds; one that fails, or that the bridge was away for, is done anew."""
        while True:
            try:
                while not await self.until(self.perceives, 60):
                    pass
                return await step(*arguments)
            except Failed as why:
                print("again, for", why)
                await self.me.sleep(3)

    async def fly_lane(self, lane, latitude, begin, end):
        print("lane", lane)
        await self.at(latitude, begin)
        await self.act("goto", latitude, end, self.height)

    async def return_home(self):
        if self.armed():
            await self.act("return_to_launch")

    async def look(self):
        async for change in self.seen:
            if change.name == "victim" and change.parameters[0] not in self.found:
                victim, latitude, longitude = change.parameters
                self.found.add(victim)
                print("victim", victim, "at", latitude, longitude)
                await self.tell(self.rescuers, "tell", "victim", victim, latitude, longitude)

    # The book. Each question may come again, after an answer that was lost, and then gets the same answer.

    async def heard(self, sender, performative, subject, victim, *_):
        promise = self.book.get(victim)
        its = promise is not None and promise.rescuer == sender
        match performative, subject:
            case "askOne", "claim":
                return its or await self.promise(victim, sender)
            case "askOne", "may_drop":
                if not its and not await self.promise(victim, sender):
                    return False
                self.book[victim].cleared = True
                return True
            case "tell", "rescued":
                print(sender, "has rescued", victim)
                self.rescued.add(victim)
                self.book.pop(victim, None)
            case "achieve", "give_back" if its:
                print(sender, "gives", victim, "back")
                await self.take_back(victim)

    async def promise(self, victim, rescuer):
        """Promise a victim if nobody else has it. Returns whether it did."""
        others = {other: promise for other, promise in self.book.items() if promise.rescuer == rescuer}
        if victim not in self.missing() or victim in self.book or any(one.cleared for one in others.values()):
            return False
        for other in others:  # who asks for a victim has no other one any more: it may not have heard that it got it
            await self.take_back(other)
        self.book[victim] = promise = Promise(rescuer)
        await self.tell(self.rescuers, "tell", "held", victim, rescuer)
        self.tasks.create_task(self.expire(victim, promise))
        return True

    async def take_back(self, victim):
        await self.tell(self.rescuers, "untell", "held", victim, self.book.pop(victim).rescuer)

    async def expire(self, victim, promise):
        """A victim is stranded by nobody: a promise ends with its time, or when the rescuer is away for too long."""
        held = away = 0
        pause = self.patience / 4
        while held < self.lease and away < self.patience:
            await self.me.sleep(pause)
            if self.book.get(victim) is not promise:
                return
            held += pause
            away = 0 if await self.me.there(promise.rescuer) else away + pause
        if promise.cleared:  # whether it dropped its buoy nobody will ever know: two buoys are better than none
            await self.me.sleep(self.lost)
        if self.book.get(victim) is promise:
            print(victim, "is free again:", promise.rescuer, "is lost" if promise.cleared else "is late")
            await self.take_back(victim)


async def run(me, **values):
    scout = Scout(me, **values)
    async with asyncio.TaskGroup() as scout.tasks:
        for work in scout.search, scout.look, scout.listen:
            scout.tasks.create_task(work())
