"""The driver fed with every packet that a real ArduCopter sent."""

import os
from collections import Counter

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.bridge.percepts import PerceptPublisher
from bridged.drivers.api import Outcome, Value
from bridged.drivers.mavlink.action_binding import bind_action, procedure_of
from bridged.drivers.mavlink.actions.context import ProcedureRun
from bridged.drivers.mavlink.session import VehicleSession
from bridged.drivers.mavlink.vehicle.commands import Identity
from bridged.drivers.mavlink.vehicle.state import Place
from schemas.manifest.loader import load_manifest
from schemas.wire.records import Perception
from schemas.wire.term_text import write
from tests.bridged.recorded import DATA, RECORDINGS, moments, packet_count, packets
from tests.bridged.sky import VirtualClock

MANIFEST = load_manifest("copter")
GROUND = Identity(255, 190, 1)


class Replay:
    """A conversation that hears what a vehicle once said, at the times at which it said it."""

    def __init__(self, name: str, identity: Identity = GROUND) -> None:
        self.name, self.identity = name, identity
        self.told: list[tuple[float, Perception]] = []
        self.sent: Counter[str] = Counter()
        self.messages: list[dialect.MAVLink_message] = []
        self.clock = VirtualClock()
        self.percepts = PerceptPublisher(
            MANIFEST,
            ["uav"],
            lambda _agent, change: self.told.append((self.now, change)),
            robot="r",
            boot="b",
            clock=self.clock,
        )
        self.talk = VehicleSession(MANIFEST, identity, self._send, self.percepts.take, self.clock)
        self.ended: dict[str, tuple[float, Outcome]] = {}

    @property
    def now(self) -> float:
        """Mission seconds."""
        return self.clock.time

    @now.setter
    def now(self, now: float) -> None:
        self.clock.time = now

    def run(self, *actions: tuple[float, str, dict[str, Value]]) -> None:
        """Replay everything; begin each action at its time, and note when and how it ends."""
        waiting, running = sorted(actions, key=lambda action: action[0]), list[ProcedureRun]()
        for packet in packets(self.name):
            while self.now + 0.1 < packet.at:
                self.tick(self.now + 0.1)
            while waiting and waiting[0][0] <= packet.at:
                _, name, arguments = waiting.pop(0)
                entry = MANIFEST.actions[name]
                action = bind_action(entry, arguments, self.talk.vehicle.modes)
                procedure = procedure_of(entry, action.number)
                run = ProcedureRun(name, procedure=procedure, action=action, moves=entry.motion, by_agent=True)
                running.append(self.talk.begin(run))
            self.clock.time = packet.at
            self.talk.receive(packet.message)
            self.percepts.tick()
            for run in [run for run in running if run.outcome is not None]:
                running.remove(run)
                assert run.outcome is not None
                self.ended[run.name] = (self.now, run.outcome)

    def _send(self, message: dialect.MAVLink_message) -> None:
        self.sent.update([message.get_type()])
        self.messages.append(message)

    def tick(self, now: float) -> None:
        self.clock.time = now
        self.talk.tick()
        self.percepts.tick()


@pytest.mark.parametrize("name", RECORDINGS)
def test_every_packet_of_the_recordings_is_decoded(name: str) -> None:
    replay, decoded = Replay(name), 0
    for packet in packets(name):
        assert packet.message.get_type() not in ("BAD_DATA", "UNKNOWN")
        replay.clock.time = packet.at
        replay.talk.receive(packet.message)
        decoded += 1
    assert decoded == packet_count(name) > 1000
    assert replay.talk.received > decoded / 4


def test_the_percept_sequence_of_the_recorded_flight_is_told_as_it_was_reviewed() -> None:
    replay = Replay("single_uav")
    replay.run()
    sequence = "".join(
        f"{at:.3f} {one.update} {one.name}({','.join(map(write, one.parameters))})\n" for at, one in replay.told
    )
    golden = DATA / "single_uav.percepts.txt"
    if os.environ.get("ARGOSY_REWRITE_GOLDEN"):
        golden.write_text(sequence)
    assert sequence == golden.read_text()
    assert [one.header.seq for _, one in replay.told] == list(range(1, len(replay.told) + 1))


def test_the_actions_of_the_recorded_flight_are_confirmed_when_the_state_shows_it() -> None:
    at = moments("single_uav")
    replay = Replay("single_uav")
    goal: dict[str, Value] = {"latitude": -27.603683, "longitude": -48.518052, "altitude": 40.0}
    replay.run(
        (at["set_mode_guided"], "set_mode", {"mode": "GUIDED"}),
        (at["arm"], "arm_motors", {"arm": True}),
        (at["takeoff_5"], "takeoff", {"altitude": 5.0}),
        (at["setpoint_goal"], "goto", goal),
        (at["set_mode_rtl"], "return_to_launch", {}),
    )
    assert {name: outcome.state for name, (_, outcome) in replay.ended.items()} == {
        "set_mode": "succeeded",
        "arm_motors": "succeeded",
        "takeoff": "succeeded",
        "goto": "succeeded",
        "return_to_launch": "succeeded",
    }
    done = {name: when for name, (when, _) in replay.ended.items()}
    assert 0.9 < done["arm_motors"] - at["arm"] < 2.5, "armed at two HEARTBEATs, not at the acknowledgement"
    assert abs(done["takeoff"] - at["takeoff_5_reached.seen"]) < 1.5
    assert abs(done["goto"] - at["goal_reached.seen"]) < 3
    stood = done["return_to_launch"] - at["rtl_disarmed.seen"]
    assert 1.0 < stood < 3.5, "it is seen to stand for two seconds after its motors stopped"


def test_a_mode_that_falls_back_after_its_acknowledgement_is_not_a_success_at_once() -> None:
    at = moments("refusals")
    replay = Replay("refusals")
    replay.run((at["set_mode_guided_at_boot"], "set_mode", {"mode": "GUIDED"}))
    when, outcome = replay.ended["set_mode"]
    assert outcome.state == "failed"
    assert when > at["set_mode_guided_at_boot"] + 1
    assert replay.sent["COMMAND_LONG"] > 1, "it is asked for again"


FAR_AWAY: dict[str, Value] = {"latitude": -27.6, "longitude": -48.5, "altitude": 40.0}


@pytest.mark.parametrize(
    ("moment", "action", "arguments", "reason"),
    [
        ("arm_in_land", "arm_motors", {"arm": True}, "Arm: LAND mode not armable"),
        (
            "takeoff_not_armed",
            "takeoff",
            {"altitude": 5.0},
            "the vehicle refused MAV_CMD_NAV_TAKEOFF (FAILED); the vehicle is not armed, on the ground, in GUIDED",
        ),
        ("setpoint_outside_circle_fence", "setpoint", FAR_AWAY, "did not take the target"),
        ("setpoint_above_fence_ceiling", "setpoint", FAR_AWAY, "did not take the target"),
    ],
)
def test_a_refusal_tells_the_vehicles_reason_or_else_its_state(
    moment: str, action: str, arguments: dict[str, Value], reason: str
) -> None:
    replay = Replay("refusals")
    replay.run((moments("refusals")[moment], action, arguments))
    _, outcome = replay.ended[action]
    assert outcome.state == "refused"
    assert reason in outcome.reason


def test_a_target_outside_guided_is_refused_without_being_sent() -> None:
    at = moments("refusals")
    replay = Replay("refusals")
    replay.run((at["setpoint_outside_guided"], "setpoint", FAR_AWAY))
    _, outcome = replay.ended["setpoint"]
    assert outcome.state == "refused"
    assert "in BRAKE" in outcome.reason
    assert not replay.sent["SET_POSITION_TARGET_GLOBAL_INT"]


def test_a_failsafe_in_flight_fails_the_running_action_and_is_a_percept() -> None:
    at = moments("failsafe")
    replay = Replay("failsafe")
    replay.run((at["set_mode_guided"], "set_mode", {"mode": "GUIDED"}), (at["gcs_failsafe_rtl.seen"] - 1, "land", {}))
    assert replay.ended["set_mode"][1].state == "succeeded"
    assert replay.ended["land"][1] == Outcome(
        "failed",
        "the mode became RTL, which nobody here asked for (pilot, ground station or failsafe): GCS Failsafe",
        "pilot",
    )
    overrides = [one.parameters for _, one in replay.told if one.name == "override"]
    assert overrides[0] == ("RTL",)


def test_a_reboot_is_noticed_and_the_streams_are_asked_for_again() -> None:
    at = moments("failsafe")
    replay = Replay("failsafe")
    asked: list[tuple[float, int]] = []
    tick = replay.tick

    def watched(now: float) -> None:
        before = replay.talk.streams.requested
        tick(now)
        asked.append((now, replay.talk.streams.requested - before))

    replay.tick = watched  # type: ignore[method-assign]
    replay.run()
    assert replay.talk.vehicle.reboots == 1
    asked_again = sum(count for when, count in asked if when > at["rebooted"])
    assert asked_again >= 6


def test_only_the_vehicle_that_is_ours_is_heard_among_three() -> None:
    replay = Replay("three_uav", Identity(255, 190, 2))
    replay.run()
    last = replay.talk.vehicle
    assert last.home.distance(Place(-27.604033, -48.518363, 0)) == pytest.approx(10, abs=1)
