"""A rescuer of a search and rescue (the paper, section 5.2). It hears of victims from the scout, negotiates with the
other rescuers who goes, flies to its victim, drops a buoy, returns and takes a new one, and goes on
while its battery lasts.

What to do next follows from what it knows now, and never from where in its doing it was. Above all it looks at the
latch that holds the buoy: whatever became of the action that opens it, open means dropped, and closed means not.
"""

import asyncio

from benchmarks.imperative.flying import Failed, Flyer, metres
from commd.client import NotSent


class Rescuer(Flyer):
    def __init__(self, me, height, scout, peers, battery_low=40):
        """Below `battery_low` percent it turns back, and 20 more are enough to go out."""
        super().__init__(me, height)
        self.scout, self.peers, self.battery_low = scout, peers, battery_low
        self.victims, self.held, self.rescued = {}, {}, set()
        self.mine = self.rescuing = None
        self.search_over = self.resting = False

    def gone(self):
        return self.percept("latch")[0] >= 1500  # microseconds of the servo; 0 before it has moved at all

    def aboard(self):
        return not self.gone()

    def spent(self):
        return 0 <= self.battery() < self.battery_low

    def ready(self):
        return self.battery() < 0 or self.battery() >= min(self.battery_low + 20, 95)

    def off(self, place):
        return metres(self.percept("global_pos"), place)

    def at_home(self):
        return self.off(self.percept("home_pos")) < 5

    def open(self):
        """The victims that nobody else is to rescue."""
        others = {victim for victim, rescuer in self.held.items() if rescuer != self.me.name}
        return self.victims.keys() - self.rescued - others

    def promised(self):
        return [victim for victim in self.open() if victim in self.held]

    def bid(self, victim):
        """What it would take to rescue a victim: the way, longer with an emptier battery. Equal bids are told apart by
        the name. False if it is busy."""
        if not self.perceives() or self.mine is not None or self.gone() or not self.ready() or self.armed():
            return False
        return [self.off(self.victims[victim]) * (2 - self.battery() / 100), self.me.name]

    def perceives(self):
        return super().perceives("latch", "home_pos")  # after a cold start home is known last

    async def serve(self):
        while True:
            try:
                await self.step()
            except (Failed, NotSent) as why:
                print("again, for", why)
                await self.me.sleep(3)

    async def step(self):
        if not self.perceives():
            await self.until(self.perceives, 60)
        elif self.mine is not None and self.gone():
            await self.report(self.mine)
        elif self.mine is not None and self.spent():
            print("too little battery for", self.mine)
            await self.tell([self.scout], "achieve", "give_back", self.mine)
            self.mine = None
        elif self.mine is not None:
            self.rescuing = asyncio.create_task(self.rescue(self.mine))
            await asyncio.wait([self.rescuing])
            if not self.rescuing.cancelled():
                self.rescuing.result()
        elif self.armed():
            await self.act("return_to_launch")
        elif not self.at_home():
            print("I wait to be carried home")
            await self.until(self.at_home, 60)
        elif self.gone():
            print("a new buoy")
            await self.act("load_buoy")
            await self.until(self.aboard, 10)
        elif not self.open() and self.search_over and not self.resting:
            self.resting = True
            print("resting")
        elif not self.open():
            self.news.clear()
            await self.news.wait()
        elif not self.ready():
            print("my battery has", self.battery(), "%: I wait until it has more")
            await self.until(self.ready, 600)
        elif self.promised():  # the answer to a claim was lost
            self.go_for(self.promised()[0])
        else:
            self.resting = False
            await self.negotiate()

    # Who goes: the nearest victim first, of those that nobody else is better placed for. The others answer by their own
    # bid, or not at all when they are busy, dead or cut off.

    async def negotiate(self):
        for mine, victim in sorted((self.bid(victim), victim) for victim in self.open()):
            answers = await asyncio.gather(*(self.ask(peer, "bid", victim, 10) for peer in self.peers))
            if min([mine, *filter(None, answers)]) == mine:
                return await self.claim(victim)
        return await self.me.sleep(3)

    async def claim(self, victim):
        if await self.ask(self.scout, "claim", victim, 10):
            self.go_for(victim)
        else:
            await self.me.sleep(1)

    def go_for(self, victim):
        print("I go for", victim)
        self.mine = victim

    # The rescue. Dropping needs the scout's leave, asked for above the victim; without an answer it is asked for again.

    async def rescue(self, victim):
        await self.at(*self.victims[victim])
        leave = await self.ask(self.scout, "may_drop", victim, 15)
        if leave and self.off(self.victims[victim]) < 3:
            await self.act("drop_buoy")
            await self.until(self.gone, 10)
        elif leave is False:
            print(victim, "is another's now")
            self.mine = None

    async def report(self, victim):
        print("buoy dropped for", victim)
        await self.tell([self.scout, *self.peers], "tell", "rescued", victim)
        self.rescued.add(victim)
        self.mine = None

    async def heard(self, sender, performative, subject, *values):
        match performative, subject, values:
            case "tell", "victim", (victim, latitude, longitude):
                self.victims[victim] = latitude, longitude
            case "tell", "rescued", (victim,):
                self.rescued.add(victim)
            case "tell", "held", (victim, rescuer):
                self.held[victim] = rescuer
                if victim == self.mine and rescuer != self.me.name:  # it was away for too long: it turns back
                    print(rescuer, "goes for", victim)
                    self.mine = None
                    if self.rescuing:
                        self.rescuing.cancel()
            case "untell", "held", (victim, _):
                self.held.pop(victim, None)
            case "tell", "search_over", _:
                self.search_over = True
            case "askOne", "bid", (victim,):
                return self.bid(victim) if victim in self.open() else False


async def run(me, **values):
    rescuer = Rescuer(me, **values)
    await asyncio.gather(rescuer.serve(), rescuer.listen())
