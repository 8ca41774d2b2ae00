"""A bridge and a simulated copter in virtual time: real bytes both ways, no sockets, and every fault on demand."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.bridge.bridge import Bridge
from bridged.bridge.composite_driver import CompositeDriver
from bridged.drivers.api import Outcome
from bridged.drivers.mavlink.driver import MavlinkDriver
from bridged.drivers.mavlink.transport.framing import Encoder, Framer, WireCounters
from bridged.simulation.vehicle.fault_injection import Faults, LinkFaults
from bridged.simulation.vehicle.geodesy import Place
from bridged.simulation.vehicle.vehicle import Vehicle
from commd.common.clock import Clock
from schemas.manifest.loader import Manifest, load_manifest
from schemas.mission.model import read_mission
from schemas.wire.records import Action, ActionStatus, Header, Perception
from schemas.wire.terms import Term
from tests.bridged.components import Component

HOME = Place(-27.604033, -48.518363, 21.0)
GOAL = (-27.603683, -48.518052, 40)
STEP = 0.02
MISSION = """
mission: test
agents:
  uav: {program: uav.asl, robot: uav1}
  other: {program: uav.asl, robot: uav1}
robots:
  uav1:
    manifest: copter
    link: udpin:127.0.0.1:0
    simulate: {vehicle: copter, home: [-27.604033, -48.518363, 21.0]}
"""

Message = dialect.MAVLink_message
Passes = Callable[[Message], bool]


class VirtualClock(Clock):
    """Time that passes when a test says so."""

    def __init__(self, speed: float = 1.0) -> None:
        super().__init__(speed)
        self.time = 0.0

    def now(self) -> float:
        """Mission seconds."""
        return self.time

    def wall(self) -> float:
        """Wall seconds, as if the mission ran at its speed."""
        return self.time / self.speed

    async def sleep(self, mission_seconds: float) -> None:
        """Wait until a test has let so much time pass."""
        until = self.time + mission_seconds
        while self.time < until:
            await asyncio.sleep(0)


class Sky:
    """One vehicle, one bridge, and the air between them."""

    def __init__(
        self,
        state: Path,
        *,
        mission: str = MISSION,
        manifest: Manifest | None = None,
        speed: float = 1.0,
        clock: VirtualClock | None = None,
        vehicle: Vehicle | None = None,
        faults: Faults | None = None,
    ) -> None:
        self.clock = clock or VirtualClock(speed)
        self.vehicle = vehicle or Vehicle(HOME, faults=faults)
        self.air_up, self.air_down = LinkFaults(faults or Faults(), "up"), LinkFaults(faults or Faults(), "down")
        self.percepts: list[tuple[str, Perception]] = []
        self.statuses: list[ActionStatus] = []
        self.sent: list[Message] = []
        self.uplink: deque[bytes] = deque()
        self.downlink: deque[Message] = deque()
        self.components: list[Component] = []
        """Cameras and gimbals beside the autopilot."""
        self.hears_us: Passes = lambda message: True
        self.we_hear: Passes = lambda message: True
        self.bridge = Bridge(
            read_mission(mission, Path("test.yaml")),
            "uav1",
            manifest or load_manifest("copter"),
            self.clock,
            state / "uav1.actions",
            lambda agent, change: self.percepts.append((agent, change)),
            lambda agent, status: self.statuses.append(status),
            boot=f"b{id(self):x}",
        )
        assert isinstance(self.bridge.driver, CompositeDriver)
        assert isinstance(self.bridge.driver.own, MavlinkDriver)
        self.driver = self.bridge.driver.own
        self.ours = Encoder(self.driver.identity.system, self.driver.identity.component)
        self._theirs = Encoder(self.vehicle.system, 1)
        self._at_vehicle, self._at_bridge = Framer(WireCounters()), Framer(WireCounters())
        self.driver._send = lambda message: self.uplink.append(self.ours.pack(message))  # it leaves with the next step
        self._counter = 0

    def step(self) -> None:
        """Let 20 ms of mission time pass for both."""
        self.clock.time += STEP
        now = self.vehicle.age
        arrived = [piece for packet in self.uplink for piece in self.air_up.carry(packet, now)]
        self.uplink.clear()
        for piece in arrived + self.air_up.due(now):
            self._reach_vehicle(piece)
        self.downlink.extend(self.vehicle.advance(STEP))
        while self.downlink:
            for piece in self.air_down.carry(self._theirs.pack(self.downlink.popleft()), now):
                self._reach_bridge(piece)
        for piece in self.air_down.due(now):
            self._reach_bridge(piece)
        for component in self.components:
            for packet in component.step(self.clock.time):
                self._reach_bridge(packet)
        self.driver.tick()
        self.bridge.step()

    def _reach_vehicle(self, data: bytes) -> None:
        for message in self._at_vehicle.feed(data, datagram=True):
            self.sent.append(message)
            if any(component.takes(message) for component in self.components):
                continue  # an autopilot passes on what is for a component that it has heard
            if self.hears_us(message):
                self.downlink.extend(self.vehicle.receive(message))

    def _reach_bridge(self, data: bytes) -> None:
        for message in self._at_bridge.feed(data, datagram=True):
            if self.we_hear(message):
                self.driver.receive(message)

    def forward(self, until: Callable[[], object], what: str, within: float = 120.0) -> float:
        """Let time pass until a wish is true; returns how long it took. Fails with the wish in words."""
        start = self.clock.time
        while not until():
            assert self.clock.time - start < within, f"{what} did not happen within {within:g} s"
            self.step()
        return self.clock.time - start

    def wait(self, seconds: float) -> None:
        """Let so many mission seconds pass."""
        until = self.clock.time + seconds
        while self.clock.time < until:
            self.step()

    def begin(self, name: str, *parameters: Term, agent: str = "uav", **fields: object) -> list[ActionStatus]:
        """Ask for an action; the list grows with its statuses."""
        self._counter += 1
        heard: list[ActionStatus] = []
        request = Action(header=Header(source=agent), id=f"{agent}:t:{self._counter}", parameters=parameters)
        for field, value in fields.items():
            request = type(request)(
                **{one: getattr(request, one) for one in request.__struct_fields__} | {field: value}
            )
        self.bridge.action_server.ask(agent, name, request, heard.append)
        return heard

    def do(self, name: str, *parameters: Term, within: float = 300.0, **fields: object) -> ActionStatus:
        """Ask for an action and let time pass until its final status."""
        return self.end(self.begin(name, *parameters, **fields), within)

    def end(self, heard: list[ActionStatus], within: float = 300.0) -> ActionStatus:
        """Let time pass until the final status of an action that has begun."""
        self.forward(lambda: heard[-1].final, f"the end of {heard[-1].name}", within)
        return heard[-1]

    def done(self, name: str, *parameters: Term, **fields: object) -> ActionStatus:
        """Do an action, which must succeed."""
        status = self.do(name, *parameters, within=600.0, **fields)
        assert status.state == "succeeded", f"{name}: {status.reason}"
        return status

    def belief(self, name: str, agent: str = "uav") -> tuple[Term, ...] | None:
        """What an agent perceives now under a name."""
        found = self.beliefs(name, agent)
        return found[0] if found else None

    def beliefs(self, name: str, agent: str = "uav") -> list[tuple[Term, ...]]:
        """All that an agent perceives now under a name."""
        return [one.parameters for one in self.bridge.percepts.sets[agent].present() if one.name == name]

    def told(self, name: str, agent: str = "uav") -> list[tuple[Term, ...]]:
        """All that an agent has been told so far under a name."""
        return [one.parameters for who, one in self.percepts if (who, one.name) == (agent, name)]

    def armed(self) -> Sky:
        """Ready and armed."""
        self.done("set_mode", "GUIDED")
        self.done("arm_motors", True)
        return self

    def flying(self, altitude: float = 5) -> Sky:
        """Ready, armed and at an altitude."""
        self.armed().done("takeoff", altitude)
        return self

    def pilot_sets(self, mode: int) -> None:
        """A pilot, or another ground station, sets a mode."""
        self.downlink.extend(self.vehicle.receive(dialect.MAVLink_set_mode_message(1, 1, mode)))

    def pretend(self, asked: Passes, result: int = dialect.MAV_RESULT_ACCEPTED, text: str = "") -> None:
        """From now on the vehicle only acknowledges what is asked of it, and does not do it."""

        def hears(message: Message) -> bool:
            if not asked(message):
                return True
            self.downlink.append(dialect.MAVLink_command_ack_message(message.command, result, 0, 0, 1, 191))
            if text:
                self.downlink.append(dialect.MAVLink_statustext_message(4, text.encode()))
            return False

        self.hears_us = hears

    def commands(self, number: int) -> list[Message]:
        """The commands of a kind that were sent so far."""
        return [one for one in self.sent if one.get_type() == "COMMAND_LONG" and one.command == number]


def is_ack_of(number: int) -> Passes:
    """Whether a message acknowledges a command."""
    return lambda message: message.get_type() == "COMMAND_ACK" and message.command == number


def is_command(number: int) -> Passes:
    """Whether a message is a command of a kind."""
    return lambda message: message.get_type() == "COMMAND_LONG" and message.command == number


def end_of(status: ActionStatus | Outcome) -> tuple[str, str]:
    """How an action ended, and why."""
    return status.state, status.reason
