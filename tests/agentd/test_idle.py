"""Whether an agent says of itself that it has nothing in mind: what its robot's bridge goes by."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.agentd.hosts import host_on
from tests.support.buses import Connect, bus_test, until


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
@bus_test
async def test_an_agent_whose_intention_waits_is_not_idle(connect: Connect, tmp_path: Path, body: str) -> None:
    agent = await host_on(await connect("a"), "a", f"!go. +!go <- {body}. +!later.", tmp_path, others=("other",))
    await until(lambda: "begun" in agent.prints, "the intention waits")
    assert agent.host.health().idle is False
    await agent.end()


@pytest.mark.parametrize("program", ["!go. +!go <- .wait(go, 10, _); .print(done).", "!go. +!go <- .print(done); no."])
@bus_test
async def test_an_agent_whose_plans_have_ended_is_idle(connect: Connect, tmp_path: Path, program: str) -> None:
    agent = await host_on(await connect("a"), "a", program, tmp_path)
    await until(lambda: agent.host.health().idle, "it has nothing in mind")
    assert "done" in agent.prints
    await agent.end()
