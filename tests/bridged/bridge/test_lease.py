"""One agent has a robot at a time: held, released, handed over, taken by rank, lost; a copter in virtual time."""

import asyncio
from pathlib import Path

import pytest

from bridged.bridge.lease import IDLE, Lease
from bridged.bridge.safety_orders import Step
from schemas.wire.terms import Atom
from tests.bridged.sky import GOAL, MISSION, Sky, end_of

RANKED = MISSION.replace("    link:", "    lease: {priority: [other]}\n    link:")


@pytest.fixture
def sky(tmp_path: Path) -> Sky:
    return Sky(tmp_path).flying()


def holder(sky: Sky) -> tuple[object, object]:
    """Whom each agent perceives as the holder."""
    return sky.belief("holder", "uav"), sky.belief("holder", "other")


def test_only_the_agent_that_acted_first_acts_and_the_others_are_told_who_that_is_and_what_it_does(sky: Sky) -> None:
    going = sky.begin("goto", *GOAL)
    sky.wait(2)
    refused = sky.do("get_param", "RTL_ALT", agent="other")
    assert refused.state == "refused"
    assert refused.reason.startswith("held by uav for ")
    assert refused.reason.endswith(" s; it does goto")
    assert not going[-1].final
    assert holder(sky) == ((Atom("uav"),), (Atom("uav"),))


def test_a_robot_that_is_seen_to_disarm_is_anybodys(sky: Sky) -> None:
    sky.done("land")
    sky.wait(2)
    assert holder(sky) == (None, None)
    sky.done("set_mode", "GUIDED", agent="other")
    assert holder(sky) == ((Atom("other"),), (Atom("other"),))


def test_a_robot_that_stays_on_the_ground_is_anybodys_after_a_while_without_an_action(tmp_path: Path) -> None:
    sky = Sky(tmp_path)
    sky.wait(2)
    sky.done("set_mode", "GUIDED")
    assert sky.do("set_mode", "GUIDED", agent="other").reason.startswith("held by uav for ")
    sky.wait(IDLE + 1)
    sky.done("set_mode", "GUIDED", agent="other")


def test_a_flying_robot_stays_with_its_agent_however_long_it_thinks(sky: Sky) -> None:
    sky.wait(10 * IDLE)
    assert sky.do("land", agent="other").reason.endswith("it does nothing now")


def test_the_holder_lets_go_in_flight_and_answers_for_the_robot_until_another_takes_it(sky: Sky) -> None:
    assert sky.do("release", agent="other").reason.startswith("held by uav for ")
    sky.done("release")
    assert holder(sky) == (None, None)
    assert sky.bridge.lease.answers == "uav"
    sky.done("goto", *GOAL, agent="other")
    assert sky.bridge.lease.answers == "other"
    assert sky.do("land").state == "refused"


def test_nothing_is_let_go_or_handed_over_while_an_action_of_its_runs(sky: Sky) -> None:
    sky.begin("goto", *GOAL)
    expected = ("refused", "busy: goto is running; cancel it first, or wait for its end")
    assert end_of(sky.do("release")) == expected
    assert end_of(sky.do("hand_over", Atom("other"))) == expected


def test_only_the_holder_hands_the_robot_over_and_only_to_an_agent_of_it_that_is_alive(sky: Sky) -> None:
    sky.bridge.lease.present = {"uav"}
    assert sky.do("hand_over", Atom("other"), agent="other").reason.startswith("held by uav for ")
    assert end_of(sky.do("hand_over", Atom("nobody"))) == (
        "refused",
        "hand_over: nobody is no agent of this robot; its agents are uav, other",
    )
    assert end_of(sky.do("hand_over", Atom("other"))) == ("refused", "hand_over: agent other is not alive")
    sky.bridge.lease.present = {"uav", "other"}
    final = sky.do("hand_over", Atom("other"))
    assert (final.state, final.result) == ("succeeded", True)
    assert holder(sky) == ((Atom("other"),), (Atom("other"),))
    assert sky.do("land").reason.startswith("held by other for ")
    sky.done("land", agent="other")


def test_an_agent_of_higher_rank_takes_the_robot_and_what_ran_fails_with_that_reason(tmp_path: Path) -> None:
    sky = Sky(tmp_path, mission=RANKED).flying()
    going = sky.begin("goto", *GOAL)
    sky.wait(2)
    home = sky.begin("return_to_launch", agent="other")
    assert end_of(going[-1]) == ("failed", "lease taken by other")
    assert sky.do("land").reason.startswith("held by other for ")
    assert sky.end(home, 300).state == "succeeded", home[-1].reason


@pytest.mark.parametrize(
    ("action", "argument", "state"), [("get_param", "RTL_ALT", "succeeded"), ("set_mode", "HOVER", "refused")]
)
def test_a_robot_that_is_taken_by_an_action_that_does_not_move_it_or_is_refused_at_once_holds(
    tmp_path: Path, action: str, argument: str, state: str
) -> None:
    sky = Sky(tmp_path, mission=RANKED).flying()
    going = sky.begin("goto", *GOAL)
    sky.wait(4)
    assert sky.do(action, argument, agent="other").state == state
    assert end_of(going[-1]) == ("failed", "lease taken by other")
    sky.wait(10)
    here = sky.belief("global_pos")
    sky.wait(5)
    assert sky.belief("global_pos") == pytest.approx(here, abs=2e-6), "20 cm"


def test_who_has_the_robot_outlives_the_bridge(sky: Sky, tmp_path: Path) -> None:
    sky.done("hand_over", Atom("other"))
    again = Sky(tmp_path, vehicle=sky.vehicle, clock=sky.clock)
    again.wait(2)
    assert again.do("land", id="uav:t:91").reason.startswith("held by other for ")
    again.done("release", agent="other", id="other:t:92")
    last = Sky(tmp_path, vehicle=sky.vehicle, clock=sky.clock)
    last.wait(2)
    assert last.bridge.lease.answers == "other"
    last.done("land", id="uav:t:93")


async def test_a_lost_holders_robot_is_brought_to_safety_first_and_then_anybodys(sky: Sky) -> None:
    sky.bridge.orders.agent_lost("uav", "no liveliness token", (Step("hold", 5.0), Step("rtl")))
    for _ in range(100):
        sky.step()
        await asyncio.sleep(0)
    refused = sky.begin("goto", *GOAL, agent="other")
    assert end_of(refused[-1]) == ("refused", "agent uav is lost: the bridge brings the robot to safety first")
    for _ in range(1500):
        sky.step()
        await asyncio.sleep(0)
        if not sky.bridge.lease.closed:
            break
    assert sky.vehicle.autopilot.mode.name == "RTL"
    assert holder(sky) == (None, None)
    assert sky.begin("set_mode", "GUIDED", agent="other")[0].state == "accepted"


def test_a_robot_that_knows_no_arming_is_anybodys_after_a_while_without_an_action() -> None:
    lease = Lease(["a", "b"], (), arms=False)
    lease.take("a", 0.0)
    lease.step(active=True, heard=True, busy=True, now=30.0)
    assert lease.refuses("b", "cmd_vel", 35.0) == "held by a for 35 s; it does cmd_vel"
    lease.step(active=True, heard=True, busy=False, now=30.0 + IDLE)
    assert lease.refuses("b", "", 40.0) == ""
    assert lease.answers == "a", "it may move still, and the loss of its agent matters"


def test_the_agent_that_acts_perceives_how_far_it_is_once_a_second_until_it_ends(sky: Sky) -> None:
    going = sky.begin("goto", *GOAL)
    took = sky.forward(lambda: going[-1].final, "the end")
    told = [(agent, one) for agent, one in sky.percepts if one.name == "feedback"]
    assert {agent for agent, _ in told} == {"uav"}
    distances = [one for _, one in told if one.parameters[1] == Atom("distance")]
    shown = [one for one in distances if one.update == "replace"]
    assert len(shown) == pytest.approx(took, abs=2)
    assert shown[0].parameters[0] == Atom("goto")
    assert shown[0].parameters[2] > shown[-1].parameters[2]  # type: ignore[operator]
    assert shown[0].key == (0, 1)
    assert distances[-1].update == "remove"
    assert distances[-1].header.seq <= (going[-1].after or 0), "it is gone before the action ends"
    assert sky.belief("feedback") is None


def test_whoever_stands_in_no_rank_takes_nothing_from_the_first_and_the_first_may_take_from_it() -> None:
    lease = Lease(["a", "b", "c"], ("a", "b"))
    lease.take("c", 0.0)
    assert [lease.outranks(agent) for agent in "abc"] == [True, True, False]
    lease.take("b", 0.0)
    assert [lease.outranks(agent) for agent in "abc"] == [True, False, False]
    lease.take("a", 0.0)
    assert [lease.outranks(agent) for agent in "abc"] == [False, False, False]
