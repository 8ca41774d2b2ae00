"""What a model makes of records that no honest daemon tells: it takes no harm, and nothing of it grows or commands."""

import time

import msgspec
import pytest

from argosy.fleet_model.members import MOST
from argosy.fleet_model.mission_clock import steady_clock
from schemas.wire import keys
from schemas.wire.mind_records import ActivityEvent, MindView
from schemas.wire.records import ActionStatus, Note
from schemas.wire.terms import Number, Term
from tests.argosy.fleet_model.fleet import FLEET, HOME, rescue

COMMAND = "\x1b]0;PWNED\x07\x1b[2J\u202e"
LONG = "x" * 100_000


@pytest.mark.parametrize("bad", [Number("Infinity"), Number("-Infinity"), Number("NaN"), 10**400, "north", 1e300])
def test_a_number_that_is_none_is_not_known(bad: Term) -> None:
    fleet = rescue().percept("scout", "global_pos", HOME[0], bad).percept("scout", "home_pos", bad, HOME[1])
    seen = fleet.model.robots["uav1"].seen
    assert (seen.position, seen.home, seen.track.home) == (None, None, None)
    if bad != 1e300:
        for name, parameters in (
            ("altitude", (bad,)),
            ("battery", (1, 1, bad)),
            ("gps", (3, bad)),
            ("heading", (bad,)),
        ):
            fleet.percept("scout", name, *parameters)
        fleet.percept("scout", "velocity", 0, bad, 0)
        assert (seen.altitude, seen.battery, seen.satellites, seen.heading, seen.velocity) == (None,) * 5
    fleet.percept("scout", "victim", bad, bad).action("scout", 1, "goto", "running", bad, bad)
    assert fleet.model.places.all == {}
    assert len(fleet.model.actions.open("scout")) == 1


def test_a_mind_whose_time_is_no_number_does_not_set_the_clock() -> None:
    fleet = rescue()
    fleet.model.mind("scout", MindView(agent="scout", time=float("inf")))
    mind = fleet.model.agents["scout"].mind
    assert mind.time == 0
    assert fleet.model.clock.zero is None


def test_a_name_that_nobody_can_have_is_nobody() -> None:
    fleet = rescue()
    before = [list(members) for members in (fleet.model.agents, fleet.model.robots, fleet.model.boards)]
    for name in ("bad\x1b[31mname", "a b", "constructor\n", LONG):
        fleet.comes(name, "agentd").comes(name, "bridged").percept(name, "altitude", 3.0)
        fleet.action(name, 1, "goto", "running").activity(name, ActivityEvent(kind="print", text="here"))
        fleet.model.token(keys.alive(name, "scout", "agentd", "b"), alive=True)
    assert [list(members) for members in (fleet.model.agents, fleet.model.robots, fleet.model.boards)] == before
    assert fleet.model.other_fleets == set()
    assert not fleet.model.actions.by_id


def test_what_is_kept_of_a_record_is_short_and_no_command() -> None:
    fleet, text = rescue(), COMMAND + LONG
    fields = {"id": text, "text": text, "other": text, "reason": text, "performative": text, "in_reply_to": text}
    for kind in ("print", "sent", "received", "undelivered", "outcome", "action", "log"):
        fleet.activity("scout", ActivityEvent(kind=kind, state=text, **fields))  # type: ignore[arg-type]
    status = ActionStatus(id=text, state="running", name="goto", parameters=(text,), reason=text, feedback={text: 1.0})
    fleet.model.status(keys.status(FLEET, "scout", "goto"), status)
    fleet.percept("scout", "state", text, True, True).percept("scout", "holder", text)
    fleet.percept("scout", "override", text).percept("scout", text, *HOME)
    fleet.told("uav1", "bridged", notes=(Note(text, text, text),))
    model = fleet.model
    seen = model.robots["uav1"].seen
    for one in [seen.mode, seen.holder, seen.override, seen.operator]:
        assert one.isprintable()
        assert len(one) <= 500
    kept = [
        *model.timeline.entries,
        *model.messages.newest(),
        *model.actions.by_id.values(),
        *model.places.all.values(),
    ]
    for thing in kept:
        for value in msgspec.to_builtins(thing).values():
            if isinstance(value, str):
                assert value.isprintable()
                assert len(value) <= 500
    (action,) = model.actions.by_id.values()
    assert action.parameters == ()
    assert all(len(name) <= 500 and name.isprintable() for name in action.feedback)


def test_a_robot_grows_old_while_the_router_is_away() -> None:
    fleet = rescue().told("uav1", "bridged", percepts={"scout": "b:1:0"})
    fleet.model.router(up=False)
    fleet.waits(10)
    assert fleet.model.robots["uav1"].age(fleet.at) == 10
    assert fleet.model.robots["uav1"].stale(fleet.at)


def test_nobody_sees_through_the_eyes_of_a_robot_that_is_forgotten() -> None:
    fleet = rescue().goes("uav1", "bridged").waits(5)
    for number in range(MOST):
        fleet.model.token(keys.alive(FLEET, f"r{number}", "bridged", "b"), alive=True)
    fleet.waits(1)
    assert "uav1" not in fleet.model.robots
    fleet.percept("scout", "altitude", 3.0)


def test_the_clock_goes_on_while_the_machine_sleeps(monkeypatch: pytest.MonkeyPatch) -> None:
    before, boot = steady_clock(), time.clock_gettime(time.CLOCK_BOOTTIME)
    monkeypatch.setattr(time, "clock_gettime", lambda which: boot + 3600 if which == time.CLOCK_BOOTTIME else 0.0)
    assert 3599 < steady_clock() - before < 3601
