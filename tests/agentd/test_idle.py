"""Whether an agent says of itself that it has nothing in mind: what its robot's bridge goes by."""

import pytest

from tests.agentd.hosts import Board
from tests.support.buses import until


@pytest.mark.parametrize(
    "body",
    [
        ".print(begun); .wait(go)",
        ".print(begun); .wait(600000)",
        ".print(begun); .suspend",
        ".print(begun); .send(other, askOne, where(_), A, 600000)",
        '.print(begun); .at("now +600 s", {+!later})',
    ],
)
async def test_an_agent_whose_intention_waits_is_not_idle(board: Board, body: str) -> None:
    agent = await board.host("a", f"!go. +!go <- {body}. +!later.", others=("other",))
    await until(lambda: "begun" in agent.prints, "the intention waits")
    assert agent.host.health().idle is False


@pytest.mark.parametrize("program", ["!go. +!go <- .wait(go, 10, _); .print(done).", "!go. +!go <- .print(done); no."])
async def test_an_agent_whose_plans_have_ended_is_idle(board: Board, program: str) -> None:
    agent = await board.host("a", program)
    await until(lambda: agent.host.health().idle, "it has nothing in mind")
    assert "done" in agent.prints
