"""Whom a health record is about."""

from schemas.wire.health import each_health
from schemas.wire.records import AgentHealth, Header, Health, Note

OF_BOTH = Note("router_lost", "the daemon's")
OF_SCOUT = Note("mind_paused", "the agent's")
AGENTD = Health(
    header=Header(source="pi1", boot="x"),
    daemon="agentd",
    pid=7,
    drops=1,
    bad_input=2,
    counters={"unknown_fields": 1.0},
    notes=(OF_BOTH,),
    lag=0.2,
    last_error="no disk",
    last_error_age=4.0,
    agents={
        "scout": AgentHealth(drops=10, bad_input=20, counters={"cycles": 5.0}, notes=(OF_SCOUT,), lag=1.0, idle=True),
        "uav": AgentHealth(last_error="bad percept", last_error_age=1.0),
    },
)


def test_the_record_of_another_daemon_is_about_its_own_name() -> None:
    assert list(each_health("uav1", bridge := Health(daemon="bridged"))) == [("uav1", bridge)]


def test_each_agent_of_an_agentd_has_its_own_health_and_that_of_its_process() -> None:
    found = dict(each_health("pi1", AGENTD))
    assert list(found) == ["scout", "uav"]
    assert found["scout"] == Health(
        header=Header(source="scout", boot="x"),
        daemon="agentd",
        pid=7,
        drops=11,
        bad_input=22,
        counters={"unknown_fields": 1.0, "cycles": 5.0},
        notes=(OF_SCOUT, OF_BOTH),
        lag=1.0,
        last_error="no disk",
        last_error_age=4.0,
        idle=True,
    )
    uav = found["uav"]
    assert (uav.lag, uav.notes, uav.idle) == (0.2, (OF_BOTH,), None)
    assert (uav.last_error, uav.last_error_age) == ("bad percept", 1.0)


def test_a_board_does_not_speak_for_agents_of_another_and_a_name_that_is_none_is_ignored() -> None:
    told = Health(daemon="agentd", agents={"scout": AgentHealth(), "uav": AgentHealth(), "a/b": AgentHealth()})
    assert [name for name, _ in each_health("pi2", told, {"scout": "pi1", "uav": "pi2"}.get)] == ["uav"]
