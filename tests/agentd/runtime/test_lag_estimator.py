"""How far a mind is behind."""

from __future__ import annotations

import asyncio
from pathlib import Path

from agentd.mind.data.inputs import SignalRaised
from agentd.runtime.lag_estimator import LagEstimator
from tests.agentd.hosts import host_on
from tests.support.buses import Connect, on_a_bus, until


def test_a_mind_that_takes_what_waits_between_two_looks_is_not_behind() -> None:
    backlog = LagEstimator()
    assert backlog.lag(100, 0, 1.0) == 0
    assert backlog.lag(150, 20, 2.0) == 0
    assert backlog.lag(170, 30, 3.0) == 0
    assert backlog.lag(5000, 0, 4.0) == 0


def test_a_mind_is_behind_for_as_long_as_what_waited_has_not_been_taken() -> None:
    backlog = LagEstimator()
    backlog.lag(0, 1000, 10.0)
    assert [backlog.lag(200 * second, 1000, 10.0 + second) for second in (1, 2, 3, 4)] == [1, 2, 3, 4]
    assert backlog.lag(1000, 1000, 15.0) == 0, "what waits now has not waited since then"
    assert backlog.lag(1100, 900, 16.0) == 1


def test_what_is_dropped_is_not_waited_for() -> None:
    backlog = LagEstimator()
    backlog.lag(0, 1000, 0.0)
    assert backlog.lag(1, 0, 1.0) == 0
    assert backlog.lag(2, 5, 9.0) == 0


WAITS = """
!start.
+!start <- !guarded.
@a[atomic] +!guarded <- .print(waits); .wait(60000).
+news(_) <- .print(news).
"""


def test_what_waits_for_an_atomic_plan_that_waits_itself_is_not_lag(endpoint: str, tmp_path: Path) -> None:
    async def body(connect: Connect) -> None:
        agent = await host_on(await connect("a"), "a", WAITS, tmp_path)
        await until(lambda: "waits" in agent.prints, "the atomic plan waits")
        for number in range(3):
            agent.host.take(SignalRaised.named("news", number))
        await until(lambda: len(agent.host._mind.events) == 3, "the events wait")
        agent.host.health()
        await asyncio.sleep(0.05)
        assert agent.host.health().lag == 0
        await agent.end()

    on_a_bus(endpoint, body)
