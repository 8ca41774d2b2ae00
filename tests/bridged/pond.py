"""The Zenoh driver on a real router, beside a session that is the robot: what it is told goes to lists."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import zenoh

from bridged.drivers.api import Execution, Outcome, Reading, Setup, Value
from bridged.drivers.zenoh.driver import ZenohDriver
from bridged.drivers.zenoh.registration import check_manifest
from commd.bus.bus import Bus
from commd.bus.raw import Sample
from commd.common.clock import Clock
from schemas.manifest.loader import Manifest, read_manifest
from schemas.mission.model import Robot
from tests.support.buses import served, session, subscribed, until

MANIFEST = """
[robot]
driver = "zenoh"
link_loss = "1s"
[percepts.light]
source = "lamp/state"
args = ["on"]
[actions.set_light]
params = [{name = "on", type = "boolean"}, {name = "colour", type = "string"}]
topic = "lamp/set"
fields = {"state.on" = "on", "state.rgb.0" = {value = 7}, "state.rgb.1" = {value = 8}, colour = "colour"}
[actions.tell]
params = [{name = "text", type = "string"}]
topic = "lamp/text"
latch = true
[actions.blink]
params = [{name = "times", type = "int"}]
service = "lamp/blink"
"""


def manifest(text: str = MANIFEST) -> Manifest:
    """A manifest that nothing is wrong with."""
    read = read_manifest(text, "lamp.toml")
    assert list(check_manifest(read)) == []
    return read


class Pond:
    """A driver and its robot's session."""

    def __init__(self, bridge: Bus, robot: Bus, declared: Manifest, prefix: str = "") -> None:
        self.readings: list[Reading] = []
        self.robot = robot
        self.manifest = declared
        self.driver = ZenohDriver(
            Setup(
                name="lamp",
                manifest=declared,
                robot=Robot(manifest="lamp.toml", prefix=prefix),
                folder=Path(),
                clock=Clock(),
                on_reading=self.readings.append,
                on_turn=lambda: None,
                bus=bridge,
            )
        )

    def begin(self, name: str, **arguments: Value) -> Execution:
        return self.driver.perform(name, self.manifest.actions[name], arguments)

    async def do(self, name: str, **arguments: Value) -> Outcome:
        """Perform an action and return its outcome."""
        execution = self.begin(name, **arguments)
        await until(lambda: execution.over, f"{name} ends")
        assert execution.outcome is not None
        return execution.outcome

    async def publish(self, key: str, *payloads: bytes, encoding: str = "") -> None:
        """Be the robot that publishes; returns when it is sent."""
        await subscribed(self.robot, key)
        publisher = self.robot.raw.publisher(key)
        for payload in payloads:
            publisher.put(payload, encoding)

    async def hear(self, key: str) -> list[Sample]:
        """Be the robot that listens to a key, when the bridge knows it; returns what it hears."""
        heard: list[Sample] = []
        self.robot.raw.subscribe(key, heard.append)
        await subscribed(self.driver._bus, key)
        return heard

    async def hold(self, key: str) -> list[zenoh.Query]:
        """Be the robot that answers no query yet; returns those that it is asked."""
        held: list[zenoh.Query] = []
        self.robot._session.declare_queryable(key, zenoh.handlers.Callback(held.append, indirect=False))
        await served(self.driver._bus, key)
        return held

    async def serve(self, key: str, payload: bytes | None, *, error: bool = False) -> list[bytes]:
        """Be the robot that answers each query like this; returns what it is asked."""
        asked: list[bytes] = []

        def answer(query: Sample) -> Sample | None:
            asked.append(query.payload)
            return None if payload is None else Sample(key, payload, "application/json", error=error)

        self.robot.raw.serve(key, answer)
        await served(self.driver._bus, key)
        return asked


@asynccontextmanager
async def in_a_pond(endpoint: str, *, text: str = MANIFEST, prefix: str = "") -> AsyncIterator[Pond]:
    """Yield a pond whose driver runs, with a router of its own."""
    async with (
        session(endpoint, "board", "commd", router=True),
        session(endpoint, "lamp", "bridged") as bridge,
        session(endpoint, "robot", "robot") as robot,
    ):
        pond = Pond(bridge, robot, manifest(text), prefix)
        running = asyncio.create_task(pond.driver.run())
        try:
            yield pond
        finally:
            running.cancel()
            with suppress(asyncio.CancelledError):
                await running


__all__ = ["MANIFEST", "Pond", "in_a_pond", "manifest", "served", "subscribed", "until"]
