"""The soak of actions under a router that is killed, short: its judge, and a few actions with real processes."""

from __future__ import annotations

from pathlib import Path

from tests.soak.actions import AGENTS, CLIENTS, HEARD_WITHIN, Heard, Result, Task, soak


def test_agents_and_clients_hear_the_end_that_happened_while_the_router_is_killed(tmp_path: Path) -> None:
    result = soak(10, 3, tmp_path)
    assert result.disagreements() == []
    assert {backfill for backfill, _ in result.asked} == {*AGENTS, *CLIENTS}
    assert result.outages
    assert max(result.delays().values()) <= HEARD_WITHIN


def test_the_judge_sees_a_wrong_end_a_second_execution_and_a_late_word() -> None:
    keys = [("a1", 1), ("a1", 2), ("c1", 1)]
    result = Result(asked=dict.fromkeys(keys, Task(1.0, True)), outages=[(9.0, 11.0), (20.0, 22.0)])
    for key in keys:
        result.begun[key] = 1
        result.heard[key], result.ledger[key], result.journal[key] = (
            Heard("succeeded", 12.0),
            "succeeded",
            ("succeeded", 10.0),
        )
    assert result.disagreements() == []
    assert result.delay(("a1", 1)) == 1.0, "from the router's return"
    result.heard["a1", 1] = Heard("failed", 12.0)
    result.begun["a1", 2] = 2
    assert [line.partition(":")[0] for line in result.disagreements()] == ["a1 1", "a1 2"]
