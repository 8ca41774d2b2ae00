"""The soak of actions under a router that is killed, short: its judge, and a few actions with real processes."""

from pathlib import Path

from tests.soak.actions import AGENTS, CLIENTS, HEARD_WITHIN, soak


def test_agents_and_clients_hear_the_end_that_happened_while_the_router_is_killed(tmp_path: Path) -> None:
    result = soak(10, 3, tmp_path)
    assert result.disagreements() == []
    assert {backfill for backfill, _ in result.asked} == {*AGENTS, *CLIENTS}
    assert result.outages
    assert max(result.delays().values()) <= HEARD_WITHIN
