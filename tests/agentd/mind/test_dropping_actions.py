"""An intention that no longer wants its action has it cancelled, however the program says so."""

import pytest

from agentd.mind.data.effects import CancelAction, PerformAction
from agentd.mind.data.inputs import ActionDone
from agentd.mind.execution.goal_execution import add_goal
from tests.agentd.minds import run, term


@pytest.mark.parametrize(
    "formula",
    [
        ".drop_intention(away)",
        ".drop_desire(away)",
        ".drop_all_intentions",
        ".fail_goal(away)",
        ".succeed_goal(away)",
        ".drop_all_desires",
    ],
)
def test_what_drops_a_goal_cancels_the_action_that_it_waits_for(formula: str) -> None:
    world = run(f"!away. +!away <- goto(1, 2, 3); .print(arrived). -!away <- .print(failed). +!stop <- {formula}.")
    (performed,) = world.of(PerformAction)
    add_goal(world.mind, term("stop"))
    world.settle()
    assert [one.id for one in world.of(CancelAction)] == [performed.id]
    world.feed(ActionDone(performed.id, False, "cancelled by bob", "cancelled"))
    assert world.prints == (["failed"] if "fail_goal" in formula else []), "what it comes to is nobody's any more"
