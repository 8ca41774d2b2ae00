"""What a manifest says of its actions holds: what runs beside what, how often it is sent, cancelled, told."""

from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.bridge.action_server import MAX_RUNNING
from bridged.bridge.running_action import MAX_FEEDBACK
from bridged.drivers.api import Outcome
from schemas.files.units import Duration
from schemas.manifest.loader import Manifest, Retry, load_manifest
from schemas.wire.terms import Atom
from tests.bridged.patient import Desk
from tests.bridged.sky import GOAL, Sky


def copter(action: str, **fields: Any) -> Manifest:
    """The copter's manifest with one action declared otherwise."""
    manifest = load_manifest("copter")
    return replace(manifest, actions=manifest.actions | {action: replace(manifest.actions[action], **fields)})


def test_what_does_not_move_the_robot_runs_beside_what_does(tmp_path: Path) -> None:
    sky = Sky(tmp_path).flying()
    going = sky.begin("goto", *GOAL)
    sky.wait(2)
    sky.done("get_param", "RTL_ALT")
    assert not going[-1].final
    assert sky.end(going).state == "succeeded"


def test_an_action_does_not_run_beside_itself(tmp_path: Path) -> None:
    desk = Desk(tmp_path, 2)
    first = desk.ask("a0")
    assert desk.ask("a0")[-1].reason == "busy: a0 is running"
    assert not desk.ask("a1")[-1].final
    assert not first[-1].final


def test_only_one_action_moves_the_robot(tmp_path: Path) -> None:
    sky = Sky(tmp_path).flying()
    sky.begin("goto", *GOAL)
    assert sky.do("takeoff", 9).reason == "busy: goto is running"


def test_only_so_many_actions_run_at_once(tmp_path: Path) -> None:
    desk = Desk(tmp_path, MAX_RUNNING + 1)
    begun = [desk.ask(f"a{number}")[-1] for number in range(MAX_RUNNING)]
    assert {one.state for one in begun} == {"accepted"}
    refused = desk.ask(f"a{MAX_RUNNING}")[-1]
    assert (refused.state, refused.reason) == ("refused", f"busy: {MAX_RUNNING} actions are running")


def test_a_driver_that_tells_more_and_more_figures_does_not_fill_the_agents_beliefs(tmp_path: Path) -> None:
    desk = Desk(tmp_path, 1)
    desk.ask("a0")
    for second in range(1, 100):
        desk.robot.runs[0].feedback[f"figure{second:03}"] = second
        desk.step(0.5)
    assert desk.feedback() == MAX_FEEDBACK
    desk.robot.runs[0].end(Outcome("succeeded"))
    assert desk.feedback() == 0


@pytest.mark.parametrize("times", [0, 2])
def test_a_command_that_nobody_answers_is_sent_again_as_often_as_its_manifest_says(tmp_path: Path, times: int) -> None:
    sky = Sky(tmp_path, manifest=copter("set_mode", retry=Retry(times=times, every=Duration(0.5))))
    sky.forward(lambda: sky.belief("state"), "the first heartbeat")
    sky.hears_us = lambda message: message.get_type() == "HEARTBEAT"
    final = sky.do("set_mode", "GUIDED")
    assert final.state == "failed"
    assert f"after sending it {times + 1} time" in final.reason
    assert len(sky.commands(dialect.MAV_CMD_DO_SET_MODE)) == times + 1


def test_a_motion_that_cannot_be_cancelled_ends_and_says_that_the_robot_goes_on(tmp_path: Path) -> None:
    sky = Sky(tmp_path, manifest=copter("goto", cancel="none")).flying()
    going = sky.begin("goto", *GOAL)
    sky.wait(2)
    status = sky.bridge.action_server.cancel("uav", going[0].id)
    assert (status.state, status.reason) == ("cancelled", "cancelled by uav; the vehicle goes on")
    before = sky.belief("global_pos")
    sky.wait(5)
    assert sky.belief("global_pos") != pytest.approx(before, abs=1e-5)


def test_only_the_figures_of_progress_that_the_manifest_names_are_perceived(tmp_path: Path) -> None:
    for wanted, expected in (((), set()), (("distance",), {Atom("distance")})):
        sky = Sky(tmp_path / str(len(wanted)), manifest=copter("goto", feedback=wanted)).flying()
        going = sky.begin("goto", *GOAL)
        sky.wait(3)
        told = [one.parameters for _, one in sky.percepts if one.name == "feedback"]
        assert {what for action, what, _ in told if action == Atom("goto")} == expected
        assert going[-1].feedback, "the status carries it all the same"
