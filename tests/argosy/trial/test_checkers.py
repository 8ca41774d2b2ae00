"""Each checker of a trial reports what must not be, and is silent when all is well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace

import pytest

from argosy.trial.checkers import AWARE, CALM, HANDING_OVER, SETTLED, STILL, UNATTENDED, Checkers, _Letter
from argosy.trial.event_loop import VirtualLoop
from argosy.trial.faults import Fault, Kill, StopOrder
from argosy.trial.network import Network, Query
from argosy.trial.world import SAMPLED, Seen, World
from bridged.simulation.turtle.turtle import Turtle
from bridged.simulation.vehicle.ardupilot.flight_modes import Mode
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.position_estimate import PositionEstimate
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

    def __init__(self, mission: Mission, *, faults: Sequence[Fault] = (), separation: float | None = None) -> None:
        self.mission, self.loop = mission, VirtualLoop()
        self.network = Network(self.loop)
        self.world = World(self.network, {}, faults, list)
        self.copters = {name: Copter() for name in mission.robots}
        self.pilot: SimpleNamespace = SimpleNamespace(switch=None, landed=False)
        self.kind = SimpleNamespace(name="copter")
        self.world.vehicles = {
            name: Seen(SimpleNamespace(autopilot=one, character=self.pilot, kind=self.kind))
            for name, one in self.copters.items()
        }
        self.served = True
        self.checkers = Checkers(mission, self.world, lambda robot: self.served, separation=separation)
        self.router = self.network.open("board", "commd", True, None)
        self.silent: set[str] = set()
        """Daemons that put no health."""
        self.idle: bool | None = None

    def put(self, key: str, record: Record) -> None:
        encoder = codec(type(record))
        self.router.put(key, encoder.encode(record), encoding=encoder.encoding("json"))

    def status(
        self,
        state: State,
        name: str = "takeoff",
        *parameters: Term,
        agent: str = "uav",
        number: int = 1,
        boot: str = "b",
    ) -> None:
        record = ActionStatus(
            id=f"{agent}:{number}", state=state, name=name, parameters=parameters, header=Header(boot=boot)
        )
        self.put(keys.status("fleet", agent, name), record)

    def holder(self, agent: str, *who: str) -> None:
        told = tuple(Atom(one) for one in who)
        record = Perception(name="holder", parameters=told, update="replace" if who else "remove")
        self.put(keys.percepts("fleet", agent), Perceptions(changes=(record,)))

    def mail(self, key: str, *ids: str, receipt: Receipt | None = None, owner: object = None) -> None:
        """Exchange a batch from alice to bob, or from the office to alice."""
        sender, receiver = ("mail", "scout") if key == keys.inbox("fleet", "scout") else ("scout", "rescuer1")
        messages = [Message(id=one, sender=sender, performative="tell", receiver=receiver, content="x") for one in ids]
        answer = receipt or Receipt(taken=len(ids))
        server = self.network.open("board", "server", False, owner)

        def take(query: Query) -> None:
            query.reply(query.key_expr, codec(Receipt).encode(answer), encoding=codec(Receipt).encoding("json"))
            query.drop()

        server.declare_queryable(key, SimpleNamespace(callback=take))
        self.router.get(
            key,
            SimpleNamespace(callback=lambda reply: None, drop=None),
            payload=codec(Mail).encode(Mail(messages=tuple(messages))),
            encoding=codec(Mail).encoding("json"),
        )
        self._work()
        server.close()

    def posted(self, *ids: str, receipt: Receipt | None = None) -> None:
        self.mail(keys.outbox("fleet", "scout"), *ids, receipt=receipt)

    def delivered(self, *ids: str, receipt: Receipt | None = None, life: str = "first", feeds: bool = True) -> None:
        for one in ids if feeds else ():
            self.checkers.mail.fed(life, _Letter("scout", "rescuer1", one))
        self.mail(keys.inbox("fleet", "rescuer1"), *ids, receipt=receipt, owner=life)

    def _work(self) -> None:
        self.loop.call_later(0.01, self.loop.stop)
        self.loop.run_forever()

    def after(self, seconds: float) -> None:
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

    @property
    def rules(self) -> list[str]:
        """What is found up to now."""
        return [one.rule for one in self.checkers.found]

    def end(self) -> list[str]:
        """End the run; return what was found."""
        self.checkers.finish()
        return self.rules


@pytest.fixture
def run() -> Run:
    return Run(SINGLE)


@pytest.fixture
def team() -> Run:
    return Run(TEAM)


@pytest.fixture
def shared() -> Run:
    return Run(SHARED)


# --- mail ---


def test_mail_that_arrives_once_and_in_order_is_well(team: Run) -> None:
    team.posted("1", "2")
    team.delivered("1")
    team.delivered("2")
    team.after(2 * CALM)
    assert team.end() == []


def test_mail_that_a_board_has_acknowledged_and_nobody_takes_is_lost(team: Run) -> None:
    team.posted("1")
    team.after(2 * CALM)
    assert team.end() == ["mail lost"]
    assert "1 from scout to rescuer1, acknowledged at 0.0 s" in team.checkers.found[0].text


def test_mail_that_a_board_has_refused_or_put_off_is_not_lost(team: Run) -> None:
    refused = Refusal(code="mailbox_full")
    team.posted("1", "2", receipt=Receipt(refused={0: refused}, later={1: refused}))
    team.after(2 * CALM)
    assert team.end() == []


def test_mail_that_its_receiver_puts_off_for_ever_is_lost(team: Run) -> None:
    team.posted("1")
    team.delivered("1", receipt=Receipt(later={0: Refusal(code="mailbox_full")}), feeds=False)
    team.after(2 * CALM)
    assert team.end() == ["mail lost"]


def test_mail_that_its_receiver_refuses_for_good_is_not_lost(team: Run) -> None:
    team.posted("1")
    team.delivered("1", receipt=Receipt(refused={0: Refusal(code="unreadable")}), feeds=False)
    team.after(2 * CALM)
    assert team.end() == []


def test_a_dead_letter_of_which_its_sender_is_notified_is_not_lost(team: Run) -> None:
    team.posted("1")
    team.mail(keys.inbox("fleet", "scout"), "undelivered.1")
    team.after(2 * CALM)
    assert team.end() == []


def test_mail_that_is_still_on_its_way_at_the_end_is_not_lost(team: Run) -> None:
    team.after(2 * CALM)
    team.posted("1")
    team.after(CALM / 2)
    assert team.end() == []


@pytest.mark.parametrize("silent", ["rescuer1", "pi1", "pi2"])
def test_mail_waits_for_its_receiver_and_the_boards(team: Run, silent: str) -> None:
    team.after(5)
    team.posted("1")
    team.silent = {silent}
    team.after(2 * CALM)
    team.silent = set()
    team.after(CALM / 2)
    assert team.end() == []
    team.after(CALM)
    assert team.end() == ["mail lost"]


def test_mail_waits_for_the_end_of_the_storm() -> None:
    run = Run(TEAM, faults=[Kill(at=CALM, daemon="commd pi1")])
    run.posted("1")
    run.after(1.5 * CALM)
    assert run.end() == []
    run.after(CALM)
    assert run.end() == ["mail lost"]


def test_mail_that_is_given_to_one_life_of_its_receiver_twice_is_doubled(team: Run) -> None:
    team.posted("1")
    team.delivered("1")
    team.delivered("1")
    assert team.end() == ["mail doubled"]


def test_mail_that_is_given_to_a_receiver_that_has_taken_it_in_a_former_life_is_doubled(team: Run) -> None:
    team.posted("1")
    team.delivered("1", life="first")
    team.delivered("1", life="second")
    assert team.end() == ["mail doubled"]


def test_mail_is_given_again_to_a_receiver_that_died_before_it_had_taken_it(team: Run) -> None:
    team.posted("1")
    team.checkers.mail.fed("first", _Letter("scout", "rescuer1", "1"))
    team.delivered("1", life="second")
    assert team.end() == []


def test_mail_that_is_offered_again_and_not_given_to_the_mind_is_not_doubled(team: Run) -> None:
    team.posted("1")
    team.delivered("1")
    team.delivered("1", feeds=False)
    assert team.end() == []


def test_mail_that_overtakes_is_reordered(team: Run) -> None:
    team.posted("1")
    team.posted("2")
    team.delivered("2")
    team.delivered("1")
    assert team.end() == ["mail reordered"]
    assert "1 from scout to rescuer1 was given to its receiver after 2" in team.checkers.found[0].text


# --- actions ---


def test_an_action_that_ends_twice_in_different_ways_is_reported(run: Run) -> None:
    run.status("failed", "goto")
    run.status("cancelled", "goto")
    assert run.rules == ["one final status"]


def test_an_end_that_is_told_again_is_one_end(run: Run) -> None:
    run.status("running", "goto")
    run.status("failed", "goto")
    run.status("failed", "goto")
    assert run.rules == []


def test_a_takeoff_succeeds_only_at_its_altitude(run: Run) -> None:
    copter = run.copters["uav1"]
    copter.armed, copter.up = True, 2.0
    run.after(6)
    run.status("succeeded", "takeoff", 20, number=1)
    assert run.rules == ["true end"]
    assert run.checkers.found[0].text == "takeoff(20) uav:1 succeeded; uav1 is armed, 2.0 m high"
    copter.up = 19.6
    run.after(1)
    run.status("succeeded", "takeoff", 20, number=2)
    assert run.rules == ["true end"]


@pytest.mark.parametrize("name", ["land", "return_to_launch"])
def test_a_landing_succeeds_only_on_the_ground_without_motors(run: Run, name: str) -> None:
    copter = run.copters["uav1"]
    copter.armed, copter.up, copter.mode_name = True, 0.1, "LAND"
    run.after(6)
    run.status("succeeded", name, number=1)
    assert run.rules == ["true end"]
    copter.armed = False
    run.after(1)
    run.status("succeeded", name, number=2)
    assert run.rules == ["true end"]


def test_arming_succeeds_only_if_the_motors_turn(run: Run) -> None:
    run.after(6)
    run.status("succeeded", "arm_motors", True, number=1)
    assert run.rules == ["true end"]
    run.status("succeeded", "arm_motors", False, number=2)
    run.copters["uav1"].armed = True
    run.after(1)
    run.status("succeeded", "arm_motors", True, number=3)
    assert run.rules == ["true end"]


def test_what_was_true_a_moment_ago_is_a_true_end(run: Run) -> None:
    copter = run.copters["uav1"]
    copter.armed = True
    run.after(6)
    copter.armed = False
    run.after(3)
    run.status("succeeded", "arm_motors", True)
    assert run.rules == []


def test_a_failed_action_says_nothing_about_the_vehicle(run: Run) -> None:
    run.after(6)
    run.status("failed", "takeoff", 20)
    assert run.rules == []


# --- who holds a robot ---


def test_two_agents_that_act_with_one_robot_are_reported(shared: Run) -> None:
    shared.status("running", "goto", agent="uav")
    shared.status("running", "goto", agent="pilot")
    shared.after(HANDING_OVER + 1)
    assert shared.rules == ["one holder"]
    assert "uav1 has been held by pilot, uav" in shared.checkers.found[0].text


def test_an_agent_that_takes_over_ends_the_actions_of_the_other(shared: Run) -> None:
    shared.status("running", "goto", agent="uav")
    shared.status("running", "goto", agent="pilot")
    shared.after(HANDING_OVER / 2)
    shared.status("failed", "goto", agent="uav")
    shared.after(3 * HANDING_OVER)
    assert shared.rules == []


def test_the_actions_of_a_bridge_that_has_died_hold_no_robot(shared: Run) -> None:
    shared.status("running", "goto", agent="uav", boot="first")
    shared.status("running", "goto", agent="pilot", boot="second")
    shared.after(3 * HANDING_OVER)
    assert shared.rules == []


def test_agents_that_are_told_of_different_holders_are_reported(shared: Run) -> None:
    shared.holder("uav", "uav")
    shared.holder("pilot", "pilot")
    shared.after(HANDING_OVER + 1)
    assert shared.rules == ["one holder"]


def test_agents_that_are_told_of_one_holder_agree(shared: Run) -> None:
    shared.holder("uav", "uav")
    shared.holder("pilot", "uav")
    shared.after(3 * HANDING_OVER)
    shared.holder("uav")
    shared.holder("pilot", "pilot")
    shared.after(3 * HANDING_OVER)
    assert shared.rules == []


# --- who attends to a vehicle ---

LOST = 5 + 5 + 10 + UNATTENDED
"""Seconds of the mission: agent_silence, `hold 5s`, idle_after."""


def in_air(run: Run, mode: str = "GUIDED") -> None:
    copter = run.copters["uav1"]
    copter.armed, copter.up, copter.mode_name = True, 20.0, mode


def test_a_vehicle_in_the_air_without_an_agent_is_reported(run: Run) -> None:
    in_air(run)
    run.served = False
    run.after(LOST - 1)
    assert run.rules == []
    run.after(3)
    assert run.rules == ["nobody alone"]


def test_a_vehicle_that_comes_home_needs_no_agent(run: Run) -> None:
    in_air(run, "RTL")
    run.served = False
    run.after(2 * LOST)
    assert run.rules == []


def test_a_vehicle_that_a_pilot_has_needs_no_agent(run: Run) -> None:
    in_air(run, "LOITER")
    run.served, run.pilot.switch = False, Mode.LOITER
    run.after(2 * LOST)
    assert run.rules == []


def test_a_vehicle_whose_agent_comes_back_is_not_alone(run: Run) -> None:
    in_air(run)
    for _ in range(3):
        run.served = False
        run.after(LOST - 5)
        run.served = True
        run.after(1)
    assert run.rules == []


def test_a_vehicle_in_the_air_whose_agents_intend_nothing_is_reported(run: Run) -> None:
    in_air(run)
    run.idle = True
    run.after(LOST + 5)
    assert run.rules == ["nobody alone"]
    assert "with nothing intended" in run.checkers.found[0].text


def test_a_vehicle_that_carries_out_an_action_of_an_idle_agent_is_not_alone(run: Run) -> None:
    in_air(run)
    run.idle = True
    run.status("running", "start_mission")
    run.after(2 * LOST)
    assert run.rules == []


def test_a_vehicle_that_the_operator_has_stopped_is_not_alone_before_it_is_given_back(run: Run) -> None:
    in_air(run)
    run.idle, run.world.stopped["uav1"] = True, "hold"
    run.after(2 * LOST)
    assert run.rules == []
    run.world.stopped.clear()
    run.after(LOST - 5)
    assert run.rules == []
    run.after(10)
    assert run.rules == ["nobody alone"]


def test_a_vehicle_whose_board_has_no_power_is_not_alone_before_it_has_had_time_to_boot(run: Run) -> None:
    in_air(run)
    run.served, run.world.machine("local").down_until = False, 2 * LOST
    run.after(2 * LOST)
    assert run.rules == []
    run.after(LOST + 5)
    assert run.rules == ["nobody alone"]


def test_a_mission_that_only_holds_lets_a_vehicle_stay_in_the_air() -> None:
    run = Run(read_mission(SINGLE.text.replace("[hold 5s, rtl]", "[hold]"), SINGLE.path))
    assert run.mission.robots["uav1"].on_agent_loss == ("hold",)
    in_air(run)
    run.served = False
    run.after(2 * LOST)
    assert run.rules == []


# --- what the operator has stopped ---


def stopped(run: Run, order: StopOrder = "hold") -> Copter:
    in_air(run)
    run.world.stopped["uav1"] = order
    run.after(SETTLED + 1)
    assert run.rules == []
    return run.copters["uav1"]


def test_a_stopped_vehicle_that_rests_is_well(run: Run) -> None:
    stopped(run).up += STILL - 1
    run.after(60)
    assert run.rules == []


def test_a_stopped_vehicle_may_come_to_rest_first(run: Run) -> None:
    in_air(run)
    run.world.stopped["uav1"] = "hold"
    run.after(1)
    run.copters["uav1"].up += 3 * STILL
    run.after(60)
    assert run.rules == []


def test_a_stopped_vehicle_that_moves_is_reported(run: Run) -> None:
    copter = stopped(run)
    copter.place.lat += 2 * STILL / 111_000
    run.after(1)
    assert run.rules == ["motion after stop"]


def test_a_stopped_vehicle_that_climbs_is_reported(run: Run) -> None:
    stopped(run, "pause").up += 2 * STILL
    run.after(1)
    assert run.rules == ["motion after stop"]


def test_a_stopped_vehicle_may_land(run: Run) -> None:
    copter = stopped(run)
    copter.mode_name, copter.up = "LAND", 2.0
    run.after(10)
    copter.armed = False
    run.after(10)
    assert run.rules == []


def test_a_stopped_vehicle_that_is_armed_is_reported(run: Run) -> None:
    run.world.stopped["uav1"] = "land"
    run.after(1)
    in_air(run)
    run.after(1)
    assert run.rules == ["motion after stop"]


def test_an_action_that_begins_with_a_stopped_vehicle_is_reported(run: Run) -> None:
    run.status("running", "goto", number=1)
    stopped(run)
    run.status("running", "return_to_launch", number=2)
    run.after(1)
    assert run.rules == ["motion after stop"]


def test_a_paused_vehicle_keeps_its_actions(run: Run) -> None:
    stopped(run, "pause")
    run.status("running", "goto", number=2)
    run.after(1)
    assert run.rules == []


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
    run.after(1)
    assert run.rules == rules


def test_a_vehicle_that_is_given_back_or_that_a_pilot_has_moves(run: Run) -> None:
    copter = stopped(run)
    run.pilot.switch, copter.mode_name = Mode.LOITER, "LOITER"
    copter.up += 2 * STILL
    run.after(1)
    run.pilot.switch = None
    del run.world.stopped["uav1"]
    copter.up += 2 * STILL
    run.after(60)
    assert run.rules == []


# --- pilots ---


def perceived(run: Run) -> Copter:
    """A vehicle that a pilot has in LOITER, as its agent perceives."""
    in_air(run, "LOITER")
    run.pilot.switch = Mode.LOITER
    state = Perception(name="state", parameters=("LOITER", True, True))
    run.put(keys.percepts("fleet", "uav"), Perceptions(changes=(state,)))
    run.after(AWARE + 1)
    return run.copters["uav1"]


def test_an_agent_that_takes_a_vehicle_from_its_pilot_is_reported(run: Run) -> None:
    copter = perceived(run)
    run.status("running", "set_mode", "GUIDED")
    run.after(1)
    assert run.rules == []
    copter.mode_name = "GUIDED"
    run.after(1)
    assert run.rules == ["left to the pilot"]


def test_a_vehicle_that_an_agent_has_taken_from_its_pilot_is_judged_by_the_other_rules(run: Run) -> None:
    copter = perceived(run)
    run.served, copter.mode_name = False, "GUIDED"
    run.after(LOST + 3)
    assert run.rules == ["nobody alone"]


def test_an_order_that_a_pilot_overtakes_and_a_failsafe_are_no_agents_will(run: Run) -> None:
    run.status("running", "set_mode", "RTL", number=1)
    copter = perceived(run)
    run.status("refused", "return_to_launch", number=2)
    copter.mode_name = "RTL"
    run.after(1)
    assert run.rules == []


def test_an_agent_that_does_not_perceive_the_pilot_is_not_reported(run: Run) -> None:
    in_air(run, "LOITER")
    run.pilot.switch = Mode.LOITER
    run.after(AWARE + 1)
    run.status("running", "set_mode", "GUIDED")
    run.copters["uav1"].mode_name = "GUIDED"
    run.after(1)
    assert run.rules == []


def test_an_agent_may_order_a_vehicle_that_is_given_back(run: Run) -> None:
    copter = perceived(run)
    run.pilot.switch, copter.mode_name = None, "GUIDED"
    run.after(1)
    run.status("running", "set_mode", "RTL")
    copter.mode_name = "RTL"
    run.after(1)
    assert run.rules == []


def test_a_vehicle_that_is_armed_after_its_pilot_has_landed_it_is_reported(run: Run) -> None:
    in_air(run, "LAND")
    run.pilot.landed = True
    run.after(1)
    run.copters["uav1"].armed = False
    run.after(1)
    assert run.rules == []
    run.copters["uav1"].armed = True
    run.after(1)
    assert run.rules == ["left to the pilot"]


# --- where vehicles are ---


def test_a_vehicle_above_its_limit_is_reported(run: Run) -> None:
    in_air(run)
    run.copters["uav1"].up = 61
    run.after(1)
    assert run.rules == []
    run.copters["uav1"].up = 63
    run.after(1)
    assert run.rules == ["limits"]


def test_a_vehicle_farther_than_its_limit_is_reported(run: Run) -> None:
    in_air(run)
    run.copters["uav1"].true_place.lat = -27.6 + 400 / 111_000
    run.after(1)
    assert run.rules == []
    run.copters["uav1"].true_place.lat = -27.6 + 600 / 111_000
    run.after(1)
    assert run.rules == ["limits"]


def test_a_vehicle_whose_gps_was_wrong_may_be_as_much_farther(run: Run) -> None:
    in_air(run)
    run.copters["uav1"].estimate.error = Vector(200.0)
    run.after(1)
    run.copters["uav1"].true_place.lat = -27.6 + 600 / 111_000
    run.after(1)
    assert run.rules == []
    run.copters["uav1"].true_place.lat = -27.6 + 800 / 111_000
    run.after(1)
    assert run.rules == ["limits"]


def test_vehicles_nearer_than_declared_are_reported() -> None:
    run = Run(TEAM, separation=5)
    run.world.nearest = 5.5
    run.after(1)
    assert run.rules == []
    run.world.nearest = 4.5
    run.after(1)
    assert run.rules == ["separation"]


def test_vehicles_may_be_near_if_nothing_is_declared(team: Run) -> None:
    team.world.nearest = 0.1
    team.after(1)
    assert team.rules == []


def test_a_vehicle_that_is_armed_at_the_end_is_reported(run: Run) -> None:
    in_air(run)
    run.after(1)
    assert run.end() == ["on the ground"]


def test_a_rover_that_stands_armed_at_the_end_needs_nobody(run: Run) -> None:
    in_air(run)
    run.kind.name = "rover"
    assert run.checkers.finish() == []


def test_a_vehicle_that_a_pilot_has_at_the_end_is_his(run: Run) -> None:
    in_air(run, "LOITER")
    run.pilot.switch = Mode.LOITER
    assert run.checkers.finish() == []


def test_a_vehicle_that_has_landed_is_well(run: Run) -> None:
    run.after(1)
    assert run.end() == []


def test_a_rule_is_reported_once_for_each_subject(run: Run) -> None:
    in_air(run)
    run.copters["uav1"].up = 70
    run.after(10)
    assert run.rules == ["limits"]
