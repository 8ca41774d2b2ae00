"""Actions of which nobody tells any more end, in words; those of which somebody does go on."""

from schemas.wire.mind_records import ActivityEvent
from tests.argosy.fleet_model.fleet import Fleet, rescue

HERE = (-27.6035, -48.5182, 20)


def flying() -> Fleet:
    return rescue().action("scout", 7, "goto", "running", *HERE)


def told(fleet: Fleet, seconds: int, *, agent: bool = True, bridge: bool = True) -> Fleet:
    """Time passes in which daemons tell how they are, and nobody tells of an action."""
    for _ in range(seconds):
        if agent:
            fleet.told("scout", "agentd")
        if bridge:
            fleet.told("uav1", "bridged", percepts={"scout": "b:1:0"})
        fleet.waits(1)
    return fleet


def ending(fleet: Fleet) -> tuple[str, str]:
    (action,) = fleet.model.actions.by_id.values()
    assert fleet.model.actions.open() == fleet.model.actions.open("scout") == []
    assert action.ended is not None
    assert [one.present for one in fleet.model.places.all.values()] == [False]
    return action.state, action.reason


def test_an_outcome_that_its_agent_tells_ends_an_action_whose_last_status_was_lost() -> None:
    fleet = flying().activity("scout", ActivityEvent(kind="outcome", id="scout:1:7", state="failed", reason="wind"))
    assert ending(fleet) == ("failed", "wind")


def test_an_outcome_told_by_another_agent_ends_nothing() -> None:
    fleet = flying().activity("rescuer1", ActivityEvent(kind="outcome", id="scout:1:7", state="failed"))
    assert len(fleet.model.actions.open("scout")) == 1


def test_the_action_of_an_agent_that_is_gone_ends_as_not_known() -> None:
    fleet = told(flying().goes("scout", "agentd"), 5, agent=False)
    assert ending(fleet) == ("unknown", "not known how it ended: its agent is gone")
    texts = [one.text for one in fleet.model.timeline.entries]
    assert "goto(-27.6035,-48.5182,20): not known how it ended: its agent is gone" in texts


def test_the_action_of_a_bridge_that_is_gone_ends_as_not_known() -> None:
    fleet = told(flying().goes("uav1", "bridged"), 5, bridge=False)
    assert ending(fleet) == ("unknown", "not known how it ended: its bridge is gone")


def test_a_new_life_of_the_agent_or_of_the_bridge_ends_what_the_one_before_began() -> None:
    for name, daemon, word in (("scout", "agentd", "agent"), ("uav1", "bridged", "bridge")):
        fleet = flying().waits(0.2).comes(name, daemon, "b2").goes(name, daemon, "b1")
        assert ending(told(fleet, 5)) == ("unknown", f"not known how it ended: its {word} was restarted")


def test_an_action_of_which_nobody_tells_for_long_ends_as_not_known() -> None:
    fleet = told(flying(), 10)
    (action,) = fleet.model.actions.open("scout")
    assert action.silent(fleet.at) == 10
    assert ending(told(fleet, 25)) == ("unknown", "not known how it ended: no status for 30 s")


def test_an_action_that_is_told_of_goes_on_and_one_that_was_given_up_is_taken_up_again() -> None:
    fleet = told(flying().goes("scout", "agentd"), 5, agent=False).action("scout", 7, "goto", "running", *HERE)
    (action,) = fleet.model.actions.open("scout")
    assert (action.state, action.reason, action.silent(fleet.at)) == ("running", "", None)
    assert [one.present for one in fleet.model.places.all.values()] == [True]
    assert ending(fleet.action("scout", 7, "goto", "succeeded", *HERE))[0] == "succeeded"


def test_nothing_ends_because_the_router_is_away() -> None:
    fleet = flying()
    fleet.model.router(up=False)
    fleet.waits(100)
    assert len(fleet.model.actions.open()) == 1
    fleet.model.router(up=True)
    assert len(told(fleet, 3).model.actions.open()) == 1


def test_a_model_that_stands_still_keeps_what_ran() -> None:
    fleet = flying()
    held = fleet.model.frozen()
    told(fleet.goes("scout", "agentd"), 5, agent=False)
    assert [one.text for one in held.actions.open("scout")] == ["goto(-27.6035,-48.5182,20)"]
