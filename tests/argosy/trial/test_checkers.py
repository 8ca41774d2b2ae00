"""Each checker of a trial reports what must not be, and is silent when all is well."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Self

import pytest

from argosy.trial.checkers import AWARE, CALM, HANDING_OVER, SETTLED, STILL, UNATTENDED, Checkers, _Letter
from argosy.trial.event_loop import VirtualLoop
from argosy.trial.faults import Fault, Kill, StopOrder
from argosy.trial.network import Network, Query
from argosy.trial.world import SAMPLED, Seen, World
from bridged.simulation.turtle.turtle import Turtle
from bridged.simulation.vehicle.ardupilot.flight_modes import Mode
from bridged.simulation.vehicle.autopilot import PositionEstimate
from bridged.simulation.vehicle.motion.dynamics import Vector
from schemas.mission.model import Mission, load_mission, read_mission
from schemas.wire import keys
from schemas.wire.codec import codec
from schemas.wire.records import (
    ActionStatus,
    Header,
    Health,
    Mail,
    Message,
    Perception,
    Perceptions,
    Receipt,
    Record,
    Refusal,
    State,
)
from schemas.wire.terms import Atom, Term

SINGLE = load_mission("single_uav")
TEAM = load_mission("search_and_rescue")
SHARED = read_mission(
    SINGLE.text.replace("robots:\n", "  pilot: {program: single_uav/uav.asl, robot: uav1}\nrobots:\n"), SINGLE.path
)
"""Two agents with one robot."""


@dataclass
class Copter:
    """As much of a simulated copter as the world looks at."""

    armed: bool = False
    up: float = 0.0
    mode_name: str = "GUIDED"
    true_place: SimpleNamespace = field(default_factory=lambda: SimpleNamespace(lat=-27.6, lon=-48.5))
    place: SimpleNamespace = field(default_factory=lambda: SimpleNamespace(lat=-27.6, lon=-48.5))
    estimate: PositionEstimate = field(default_factory=PositionEstimate)
    battery: SimpleNamespace = field(default_factory=lambda: SimpleNamespace(remaining=100))

    @property
    def truth(self) -> tuple[float, float]:
        return self.true_place.lat, self.true_place.lon

    @property
    def motion(self) -> SimpleNamespace:
        still = SimpleNamespace(velocity=0.0)
        return SimpleNamespace(up=SimpleNamespace(position=self.up), north=still, east=still)

    @property
    def home_on_chart(self) -> SimpleNamespace:
        return SimpleNamespace(up=0.0)

    @property
    def home(self) -> SimpleNamespace:
        return SimpleNamespace(lat=-27.6, lon=-48.5)

    @property
    def mode(self) -> SimpleNamespace:
        return SimpleNamespace(name=self.mode_name)


class Run:
    """A run that a test makes up: what is on the bus, the vehicles and the agents."""

    def __init__(self, mission: Mission, *, faults: Sequence[Fault] = ()) -> None:
        self.mission, self.loop = mission, VirtualLoop()
        self.network = Network(self.loop)
        self.world = World(self.network, {}, faults, list)
        self.copters = {name: Copter() for name in mission.robots}
        self.pilot: SimpleNamespace = SimpleNamespace(switch=None, landed=False)
        self.kind = SimpleNamespace(name="copter")
        self.world.vehicles = {
            name: Seen(SimpleNamespace(autopilot=one, vehicle_faults=self.pilot, kind=self.kind))
            for name, one in self.copters.items()
        }
        self.served = True
        self.checkers = Checkers(mission, self.world, lambda robot: self.served)
        self.router = self.network.open("board", "commd", True, None)
        self.silent: set[str] = set()
        """Daemons that put no health."""
        self.idle: bool | None = None

    def put(self, key: str, record: Record) -> Self:
        encoder = codec(type(record))
        self.router.put(key, encoder.encode(record), encoding=encoder.encodings["json"])
        return self

    def status(
        self,
        state: State,
        name: str = "takeoff",
        *parameters: Term,
        agent: str = "uav",
        number: int = 1,
        boot: str = "b",
    ) -> Self:
        record = ActionStatus(
            id=f"{agent}:{number}", state=state, name=name, parameters=parameters, header=Header(boot=boot)
        )
        return self.put(keys.status("fleet", agent, name), record)

    def holder(self, agent: str, *who: str) -> Self:
        told = tuple(Atom(one) for one in who)
        record = Perception(name="holder", parameters=told, update="replace" if who else "remove")
        return self.put(keys.percepts("fleet", agent), Perceptions(changes=(record,)))

    def mail(self, key: str, *ids: str, receipt: Receipt | None = None, owner: object = None) -> Self:
        """Exchange a batch from alice to bob, or from the office to alice."""
        sender, receiver = ("mail", "scout") if key == keys.inbox("fleet", "scout") else ("scout", "rescuer1")
        messages = [Message(id=one, sender=sender, performative="tell", receiver=receiver, content="x") for one in ids]
        answer = receipt or Receipt(taken=len(ids))
        server = self.network.open("board", "server", False, owner)

        def take(query: Query) -> None:
            query.reply(query.key_expr, codec(Receipt).encode(answer), encoding=codec(Receipt).encodings["json"])
            query.drop()

        server.declare_queryable(key, SimpleNamespace(callback=take))
        self.router.get(
            key,
            SimpleNamespace(callback=lambda reply: None, drop=None),
            payload=codec(Mail).encode(Mail(messages=tuple(messages))),
            encoding=codec(Mail).encodings["json"],
        )
        self._work()
        server.close()
        return self

    def posted(self, *ids: str, receipt: Receipt | None = None) -> Self:
        return self.mail(keys.outbox("fleet", "scout"), *ids, receipt=receipt)

    def fed(self, *ids: str, life: str = "first") -> Self:
        for one in ids:
            self.checkers.mail.fed(life, _Letter("scout", "rescuer1", one))
        return self

    def delivered(self, *ids: str, receipt: Receipt | None = None, life: str = "first", feeds: bool = True) -> Self:
        self.fed(*(ids if feeds else ()), life=life)
        return self.mail(keys.inbox("fleet", "rescuer1"), *ids, receipt=receipt, owner=life)

    def _work(self) -> None:
        self.loop.call_later(0.01, self.loop.stop)
        self.loop.run_forever()

    def after(self, seconds: float) -> Self:
        """Let time pass: vehicles are looked at, and daemons put their health."""
        until = self.loop.time() + seconds
        while self.loop.time() < until:
            self.loop.call_later(SAMPLED, self.loop.stop)
            self.loop.run_forever()
            for seen in self.world.vehicles.values():
                seen.look()
            for look in self.world.looks:
                look()
            daemons = [(name, "agentd") for name in self.mission.agents]
            daemons += [(board, "commd") for board in self.mission.board_names]
            for name, daemon in daemons:
                if name not in self.silent:
                    self.put(keys.health("fleet", name, daemon), Health(daemon=daemon, idle=self.idle))
        return self

    def copter(self, **is_now: object) -> Self:
        for name, value in is_now.items():
            setattr(self.copters["uav1"], name, value)
        return self

    def in_air(self, mode: str = "GUIDED") -> Self:
        return self.copter(armed=True, up=20.0, mode_name=mode)

    def away(self, metres: float) -> Self:
        """Let the copter truly be so far north of its home."""
        self.copters["uav1"].true_place.lat = -27.6 + metres / 111_000
        return self

    def moved(self, metres: float) -> Self:
        """Let the copter's place be so much farther north."""
        self.copters["uav1"].place.lat += metres / 111_000
        return self

    def has(self, *, served: bool | None = None, idle: bool | None = None, silent: str | None = None) -> Self:
        """Change whether the robot has an agent, whether agents intend anything, and which daemon puts no health."""
        self.served = self.served if served is None else served
        self.idle = self.idle if idle is None else idle
        self.silent = self.silent if silent is None else {silent}
        return self

    def stopped(self, order: StopOrder | None) -> Self:
        """Let the operator stop the robot, or give it back."""
        self.world.stopped.clear()
        if order is not None:
            self.world.stopped["uav1"] = order
        return self

    def at_rest(self, order: StopOrder = "hold") -> Self:
        return self.in_air().stopped(order).after(SETTLED + 1).finds()

    def switched(self, mode: Mode | None) -> Self:
        """Let the pilot's switch name a mode; None gives the vehicle back."""
        self.pilot.switch = mode
        return self

    def piloted(self) -> Self:
        """Let a pilot have the vehicle in LOITER, as its agent perceives."""
        state = Perception(name="state", parameters=("LOITER", True, True))
        self.in_air("LOITER").switched(Mode.LOITER)
        return self.put(keys.percepts("fleet", "uav"), Perceptions(changes=(state,))).after(AWARE + 1)

    def finds(self, *rules: str, text: str = "") -> Self:
        """Assert what is found up to now, and what the first finding contains."""
        assert [one.rule for one in self.checkers.found] == list(rules)
        assert not text or text in self.checkers.found[0].text
        return self

    def ends(self, *rules: str, text: str = "") -> Self:
        """End the run, and assert what is found."""
        self.checkers.finish()
        return self.finds(*rules, text=text)


LOST = 5 + 5 + 10 + UNATTENDED
"""Seconds of the mission: agent_silence, `hold 5s`, idle_after."""
FULL = Refusal(code="mailbox_full")

MAIL: dict[str, Callable[[Run], object]] = {
    "that arrives once and in order is well": lambda run: (
        run.posted("1", "2").delivered("1").delivered("2").after(2 * CALM).ends()
    ),
    "that a board has acknowledged and nobody takes is lost": lambda run: (
        run.posted("1").after(2 * CALM).ends("mail lost", text="1 from scout to rescuer1, acknowledged at 0.0 s")
    ),
    "that a board has refused or put off is not lost": lambda run: (
        run.posted("1", "2", receipt=Receipt(refused={0: FULL}, later={1: FULL})).after(2 * CALM).ends()
    ),
    "that its receiver puts off for ever is lost": lambda run: (
        run.posted("1").delivered("1", receipt=Receipt(later={0: FULL}), feeds=False).after(2 * CALM).ends("mail lost")
    ),
    "that its receiver refuses for good is not lost": lambda run: (
        run.posted("1")
        .delivered("1", receipt=Receipt(refused={0: Refusal(code="unreadable")}), feeds=False)
        .after(2 * CALM)
        .ends()
    ),
    "of whose end its sender is notified is not lost": lambda run: (
        run.posted("1").mail(keys.inbox("fleet", "scout"), "undelivered.1").after(2 * CALM).ends()
    ),
    "that is still on its way at the end is not lost": lambda run: (
        run.after(2 * CALM).posted("1").after(CALM / 2).ends()
    ),
    "waits for its receiver and the boards": lambda run: [
        Run(TEAM).after(5).posted("1").has(silent=one).after(2 * CALM).has(silent="nobody").after(CALM / 2).ends()
        .after(CALM).ends("mail lost")
        for one in ("rescuer1", "pi1", "pi2")
    ],
    "waits for the end of the storm": lambda run: (
        Run(TEAM, faults=[Kill(at=CALM, daemon="commd pi1")])
        .posted("1").after(1.5 * CALM).ends().after(CALM).ends("mail lost")
    ),
    "that is given to one life of its receiver twice is doubled": lambda run: (
        run.posted("1").delivered("1").delivered("1").ends("mail doubled")
    ),
    "that is given to a receiver that has taken it in a former life is doubled": lambda run: (
        run.posted("1").delivered("1", life="first").delivered("1", life="second").ends("mail doubled")
    ),
    "is given again to a receiver that died before it had taken it": lambda run: (
        run.posted("1").fed("1", life="first").delivered("1", life="second").ends()
    ),
    "that is offered again and not given to the mind is not doubled": lambda run: (
        run.posted("1").delivered("1").delivered("1", feeds=False).ends()
    ),
    "that overtakes is reordered": lambda run: (
        run.posted("1").posted("2").delivered("2").delivered("1")
        .ends("mail reordered", text="1 from scout to rescuer1 was given to its receiver after 2")
    ),
}  # fmt: skip


@pytest.mark.parametrize("course", MAIL.values(), ids=MAIL)
def test_mail(course: Callable[[Run], object]) -> None:
    course(Run(TEAM))


ACTIONS: dict[str, Callable[[Run], object]] = {
    "an action that ends twice in different ways is reported": lambda run: (
        run.status("failed", "goto").status("cancelled", "goto").finds("one final status")
    ),
    "an end that is told again is one end": lambda run: (
        run.status("running", "goto").status("failed", "goto").status("failed", "goto").finds()
    ),
    "a takeoff succeeds only at its altitude": lambda run: (
        run.copter(armed=True, up=2.0).after(6).status("succeeded", "takeoff", 20, number=1)
        .finds("true end", text="takeoff(20) uav:1 succeeded; uav1 is armed, 2.0 m high")
        .copter(up=19.6).after(1).status("succeeded", "takeoff", 20, number=2).finds("true end")
    ),
    "a landing succeeds only on the ground without motors": lambda run: [
        Run(SINGLE).copter(armed=True, up=0.1, mode_name="LAND").after(6)
        .status("succeeded", name, number=1).finds("true end")
        .copter(armed=False).after(1).status("succeeded", name, number=2).finds("true end")
        for name in ("land", "return_to_launch")
    ],
    "arming succeeds only if the motors turn": lambda run: (
        run.after(6).status("succeeded", "arm_motors", True, number=1).finds("true end")
        .status("succeeded", "arm_motors", False, number=2)
        .copter(armed=True).after(1).status("succeeded", "arm_motors", True, number=3).finds("true end")
    ),
    "what was true a moment ago is a true end": lambda run: (
        run.copter(armed=True).after(6).copter(armed=False).after(3).status("succeeded", "arm_motors", True).finds()
    ),
    "a failed action says nothing about the vehicle": lambda run: run.after(6).status("failed", "takeoff", 20).finds(),
    # what the operator has stopped
    "a stopped vehicle that rests is well": lambda run: run.at_rest().copter(up=20 + STILL - 1).after(60).finds(),
    "a stopped vehicle may come to rest first": lambda run: (
        run.in_air().stopped("hold").after(1).copter(up=20 + 3 * STILL).after(60).finds()
    ),
    "a stopped vehicle that moves is reported": lambda run: (
        run.at_rest().moved(2 * STILL).after(1).finds("motion after stop")
    ),
    "a stopped vehicle that climbs is reported": lambda run: (
        run.at_rest("pause").copter(up=20 + 2 * STILL).after(1).finds("motion after stop")
    ),
    "a stopped vehicle may land": lambda run: (
        run.at_rest().copter(mode_name="LAND", up=2.0).after(10).copter(armed=False).after(10).finds()
    ),
    "a stopped vehicle that is armed is reported": lambda run: (
        run.stopped("land").after(1).in_air().after(1).finds("motion after stop")
    ),
    "an action that begins with a stopped vehicle is reported": lambda run: (
        run.status("running", "goto", number=1).at_rest()
        .status("running", "return_to_launch", number=2).after(1).finds("motion after stop")
    ),
    "a paused vehicle keeps its actions": lambda run: (
        run.at_rest("pause").status("running", "goto", number=2).after(1).finds()
    ),
    "a vehicle that is given back or that a pilot has moves": lambda run: (
        run.at_rest().switched(Mode.LOITER).copter(mode_name="LOITER", up=20 + 2 * STILL).after(1)
        .switched(None).stopped(None).copter(up=20 + 4 * STILL).after(60).finds()
    ),
    # pilots
    "an agent that takes a vehicle from its pilot is reported": lambda run: (
        run.piloted().status("running", "set_mode", "GUIDED").after(1).finds()
        .copter(mode_name="GUIDED").after(1).finds("left to the pilot")
    ),
    "a vehicle that an agent has taken from its pilot is judged by the other rules": lambda run: (
        run.piloted().has(served=False).copter(mode_name="GUIDED").after(LOST + 3).finds("nobody alone")
    ),
    "an order that a pilot overtakes and a failsafe are no agents will": lambda run: (
        run.status("running", "set_mode", "RTL", number=1).piloted().status("refused", "return_to_launch", number=2)
        .copter(mode_name="RTL").after(1).finds()
    ),
    "an agent that does not perceive the pilot is not reported": lambda run: (
        run.in_air("LOITER").switched(Mode.LOITER).after(AWARE + 1).status("running", "set_mode", "GUIDED")
        .copter(mode_name="GUIDED").after(1).finds()
    ),
    "an agent may order a vehicle that is given back": lambda run: (
        run.piloted().switched(None).copter(mode_name="GUIDED").after(1)
        .status("running", "set_mode", "RTL").copter(mode_name="RTL").after(1).finds()
    ),
}  # fmt: skip


@pytest.mark.parametrize("course", ACTIONS.values(), ids=ACTIONS)
def test_actions(course: Callable[[Run], object]) -> None:
    course(Run(SINGLE))


HOLDERS: dict[str, Callable[[Run], object]] = {
    "two agents that act with one robot are reported": lambda run: (
        run.status("running", "goto", agent="uav").status("running", "goto", agent="pilot")
        .after(HANDING_OVER + 1).finds("one holder", text="uav1 has been held by pilot, uav")
    ),
    "an agent that takes over ends the actions of the other": lambda run: (
        run.status("running", "goto", agent="uav").status("running", "goto", agent="pilot").after(HANDING_OVER / 2)
        .status("failed", "goto", agent="uav").after(3 * HANDING_OVER).finds()
    ),
    "the actions of a bridge that has died hold no robot": lambda run: (
        run.status("running", "goto", agent="uav", boot="first").status("running", "goto", agent="pilot", boot="second")
        .after(3 * HANDING_OVER).finds()
    ),
    "agents that are told of different holders are reported": lambda run: (
        run.holder("uav", "uav").holder("pilot", "pilot").after(HANDING_OVER + 1).finds("one holder")
    ),
    "agents that are told of one holder agree": lambda run: (
        run.holder("uav", "uav").holder("pilot", "uav").after(3 * HANDING_OVER)
        .holder("uav").holder("pilot", "pilot").after(3 * HANDING_OVER).finds()
    ),
}  # fmt: skip


@pytest.mark.parametrize("course", HOLDERS.values(), ids=HOLDERS)
def test_holders_of_a_robot(course: Callable[[Run], object]) -> None:
    course(Run(SHARED))


def _often_alone(run: Run) -> None:
    run.in_air()
    for _ in range(3):
        run.has(served=False).after(LOST - 5).has(served=True).after(1)
    run.finds()


def _without_power(run: Run) -> None:
    run.world.machine("local").down_until = 2 * LOST
    run.in_air().has(served=False).after(2 * LOST).finds().after(LOST + 5).finds("nobody alone")


def _gps_wrong(run: Run) -> None:
    run.copters["uav1"].estimate.error = Vector(200.0)
    run.in_air().after(1).away(600).after(1).finds().away(800).after(1).finds("limits")


def _landed_by_its_pilot(run: Run) -> None:
    run.pilot.landed = True
    run.in_air("LAND").after(1).copter(armed=False).after(1).finds()
    run.copter(armed=True).after(1).finds("left to the pilot")


def _rover(run: Run) -> None:
    run.kind.name = "rover"
    run.in_air().ends()


VEHICLES: dict[str, Callable[[Run], object]] = {
    "in the air without an agent is reported": lambda run: (
        run.in_air().has(served=False).after(LOST - 1).finds().after(3).finds("nobody alone")
    ),
    "that comes home needs no agent": lambda run: run.in_air("RTL").has(served=False).after(2 * LOST).finds(),
    "that a pilot has needs no agent": lambda run: (
        run.in_air("LOITER").has(served=False).switched(Mode.LOITER).after(2 * LOST).finds()
    ),
    "whose agent comes back is not alone": _often_alone,
    "whose agents intend nothing is reported": lambda run: (
        run.in_air().has(idle=True).after(LOST + 5).finds("nobody alone", text="with nothing intended")
    ),
    "that carries out an action of an idle agent is not alone": lambda run: (
        run.in_air().has(idle=True).status("running", "start_mission").after(2 * LOST).finds()
    ),
    "that the operator has stopped is not alone before it is given back": lambda run: (
        run.in_air().has(idle=True).stopped("hold").after(2 * LOST).finds()
        .stopped(None).after(LOST - 5).finds().after(10).finds("nobody alone")
    ),
    "whose board has no power is not alone before it has had time to boot": _without_power,
    "that is armed after its pilot has landed it is reported": _landed_by_its_pilot,
    "above its limit is reported": lambda run: (
        run.in_air().copter(up=61).after(1).finds().copter(up=63).after(1).finds("limits").after(10).finds("limits")
    ),
    "farther than its limit is reported": lambda run: (
        run.in_air().away(400).after(1).finds().away(600).after(1).finds("limits")
    ),
    "whose gps was wrong may be as much farther": _gps_wrong,
    "that is armed at the end is reported": lambda run: run.in_air().after(1).ends("on the ground"),
    "that is a rover and stands armed at the end needs nobody": _rover,
    "that a pilot has at the end is his": lambda run: run.in_air("LOITER").switched(Mode.LOITER).ends(),
    "that has landed is well": lambda run: run.after(1).ends(),
}  # fmt: skip


@pytest.mark.parametrize("course", VEHICLES.values(), ids=VEHICLES)
def test_a_vehicle(course: Callable[[Run], object]) -> None:
    course(Run(SINGLE))


def test_a_mission_that_only_holds_lets_a_vehicle_stay_in_the_air() -> None:
    run = Run(read_mission(SINGLE.text.replace("[hold 5s, rtl]", "[hold]"), SINGLE.path))
    assert run.mission.robots["uav1"].on_agent_loss == ("hold",)
    run.in_air().has(served=False).after(2 * LOST).finds()


@pytest.mark.parametrize(
    ("moves", "stopped", "rules"), [(1.0, True, ["motion after stop"]), (0.0, True, []), (1.0, False, [])]
)
def test_a_stopped_turtle_rests(moves: float, stopped: bool, rules: list[str]) -> None:
    run = Run(load_mission("turtle"))
    run.world.vehicles.clear()  # no copter
    run.world.turtles = {"turtle": (turtle := Turtle())}
    if stopped:
        run.world.stopped["turtle"] = "hold"
    run.after(SETTLED + 1)
    turtle.x += moves
    run.after(1).finds(*rules)
