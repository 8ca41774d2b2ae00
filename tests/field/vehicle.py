"""A simulated copter that tells what it does, in lines of JSON on stdout: `python -m tests.field.vehicle LINK SPEED`.

Each line has `at` (the machine's monotonic seconds), `mode`, `armed` and `altitude` (m above home), whenever the mode
or the arming changes. Arguments `NAME=VALUE` set parameters of its autopilot.
"""

import asyncio
import json
import sys
import time

from bridged.drivers.mavlink.transport.address import LinkAddress
from bridged.drivers.mavlink.transport.link import open_link
from bridged.simulation.vehicle.vehicle import Vehicle
from tests.bridged.sky import HOME

STEP = 0.01
"""Wall seconds between two looks."""


async def main(link_to: str, speed: float, parameters: dict[str, float]) -> None:
    """Fly until killed."""
    vehicle, told = Vehicle(HOME), ("", False)
    for name, value in parameters.items():
        vehicle.autopilot.parameters.set(name, value)

    def hear(message: object, _: object) -> None:
        for answer in vehicle.receive(message):
            link.send(answer)

    link = await open_link(LinkAddress.parse(link_to), hear, system=1, component=1)
    before = time.monotonic()
    while True:
        now = time.monotonic()
        for message in vehicle.advance((now - before) * speed):
            link.send(message)
        before, copter = now, vehicle.autopilot
        if told != (seen := (copter.mode.name, copter.armed)):
            told, altitude = seen, round(copter.motion.up.position, 1)
            line = {"at": time.monotonic(), "mode": seen[0], "armed": seen[1], "altitude": altitude}
            print(json.dumps(line), flush=True)
        await asyncio.sleep(STEP)


if __name__ == "__main__":
    values = dict(argument.split("=") for argument in sys.argv[3:])
    asyncio.run(main(sys.argv[1], float(sys.argv[2]), {name: float(value) for name, value in values.items()}))
