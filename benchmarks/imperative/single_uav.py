"""The paper's first mission (section 5.1): take off, fly to a waypoint, return to home, land.

An action ends when the vehicle's own state shows that it was done, and fails, with the vehicle's own words, when it was
not. So there is nothing to poll here. The daemons may be started in any order: the program first waits for its robot.
"""


class Failed(Exception):
    """An action or a wait has failed, and why."""


class Uav:
    def __init__(self, me):
        self.me, self.seen = me, me.percepts()

    async def fly_mission(self, takeoff_altitude, waypoint):
        try:
            await self.until(self.connected, 120)
            await self.airborne(takeoff_altitude)
            print("flying to", waypoint)
            await self.act("goto", *waypoint)
            print("returning to home")
            await self.act("return_to_launch")
            print("mission done")
            return True
        except Failed as why:
            print("mission failed:", why)
            await self.safe()
            return False

    async def airborne(self, altitude):
        await self.act("set_mode", "GUIDED")
        if not self.armed():
            await self.act("arm_motors", True)
        print("taking off to", altitude, "m")
        await self.act("takeoff", altitude)

    async def safe(self):
        """Whatever went wrong: a flying vehicle comes home, or lands where it is, before the mission is given up."""
        for order in "return_to_launch", "land":
            try:
                await self.until(self.connected, 300)  # it or its bridge may be out of reach, which failed the mission
                if self.armed():
                    print("ordering", order)
                    await self.act(order)
                return
            except Failed as why:
                print("could not", order, why)
        print("over to the pilot")

    def connected(self):
        return any(connected for _, connected, _ in self.seen.of("state"))

    def armed(self):
        return any(armed for _, _, armed in self.seen.of("state"))

    async def act(self, action, *parameters):
        status = await self.me.perform(action, *parameters)
        if not status.result:
            raise Failed(status.reason)

    async def until(self, condition, seconds):
        """Wait for what is perceived, some seconds of the mission at most."""
        if not await self.seen.until(lambda _: condition(), self.me.wall(seconds)):
            raise Failed(f"nothing was heard of the vehicle for {seconds} s")


async def run(me, takeoff_altitude, waypoint):
    return await Uav(me).fly_mission(takeoff_altitude, waypoint)
