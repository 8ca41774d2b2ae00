"""A fleet that flies anew: what was heard of the run before is not shown as present; a mere restart changes nothing."""

from argosy.fleet_model.model import FleetModel
from schemas.wire.mind_records import ActivityEvent
from schemas.wire.records import Queue
from tests.argosy.fleet_model.fleet import HOME, Fleet, rescue

DAEMONS = (("pi1", "commd"), ("uav1", "bridged"), ("scout", "agentd"))
VICTIM = (3, -27.6035, -48.5182)


def flown() -> Fleet:
    """A run in which something of everything was heard."""
    fleet = rescue().percept("scout", "victim", *VICTIM).mind("scout", "+!search", time=200.0)
    fleet.action("scout", 1, "goto", "succeeded", *VICTIM[1:], 20).action("scout", 2, "goto", "running", -27.605, -48.5)
    fleet.mail("pi1", Queue(box="inbox", sender="rescuer1", receiver="scout", messages=3, oldest=4.0))
    return fleet.activity(
        "scout", ActivityEvent(kind="sent", id="m1", other="rescuer1", performative="tell", text="found(3)")
    )


def all_go(fleet: Fleet, boot: str = "b1") -> Fleet:
    for name, daemon in reversed(DAEMONS):
        fleet.goes(name, daemon, boot)
    return fleet


def all_come(fleet: Fleet, boot: str) -> Fleet:
    for name, daemon in DAEMONS:
        fleet.comes(name, daemon, boot)
    return fleet


def known(model: FleetModel) -> tuple[int, int, int, bool, bool]:
    """Return how many places, actions and points of the track there are, and whether mind and mail are known."""
    mind, mail = model.agents["scout"].mind is not None, model.boards["pi1"].mailboxes is not None
    return len(model.places.all), len(model.actions.by_id), len(model.robots["uav1"].seen.track.points), mind, mail


def test_with_a_new_run_all_that_was_known_of_the_one_before_goes() -> None:
    fleet = all_go(flown())
    assert known(fleet.model) == (3, 2, 1, True, True)
    all_come(fleet.waits(20), "b2")
    assert known(fleet.model) == (0, 0, 0, False, False)
    assert fleet.model.actions.open() == []
    robot = fleet.model.robots["uav1"].seen
    assert (robot.mode, robot.position, robot.track.most) == ("", None, 2_000)
    (message,) = fleet.model.messages.newest()
    assert message.undelivered == "not known: the run in which it was sent is over"
    assert (fleet.model.lives.run, fleet.model.clock.zero) == (2, None)
    texts = [one.text for one in fleet.model.timeline.entries]
    assert texts.count("a new run begins: all daemons of the one before had gone") == 1


def test_what_the_new_run_tells_is_kept_from_its_first_word_on() -> None:
    fleet = all_go(flown()).waits(20).comes("pi1", "commd", "b2").comes("uav1", "bridged", "b2")
    fleet.percept("scout", "state", "GUIDED", True, False).percept("scout", "global_pos", *HOME)
    fleet.percept("scout", "victim", *VICTIM).comes("scout", "agentd", "b2").mind("scout", time=1.0).waits(3)
    assert known(fleet.model) == (1, 0, 1, True, False)


def test_daemons_that_are_started_again_one_by_one_go_on_in_their_run() -> None:
    fleet = flown()
    for name, daemon in DAEMONS:
        fleet.goes(name, daemon).waits(2).comes(name, daemon, "b2").waits(2)
    places, actions, points, mind, _ = known(fleet.model)
    assert (fleet.model.lives.run, places, actions, points) == (1, 3, 2, 1)
    assert not mind  # that of the life before is not the present one


def test_an_observer_that_stays_does_not_make_two_runs_one() -> None:
    fleet = flown().comes("argosy-ui", "client")
    assert all_come(all_go(fleet).waits(5), "b2").model.lives.run == 2


def test_a_router_that_was_away_ends_no_run_even_if_somebody_was_started_again_meanwhile() -> None:
    fleet = flown()
    fleet.model.router(up=False)
    all_go(fleet).waits(20)
    fleet.model.router(up=True)
    fleet.comes("scout", "agentd", "b2").waits(1).comes("pi1", "commd").comes("uav1", "bridged").waits(10)
    assert (fleet.model.lives.run, *known(fleet.model)[:3]) == (1, 3, 2, 1)


def test_a_run_that_began_while_the_router_was_away_is_noticed_and_what_it_has_told_stays() -> None:
    fleet = flown()
    fleet.model.router(up=False)
    all_go(fleet).waits(20)
    fleet.model.router(up=True)
    all_come(fleet, "b2").percept("scout", "state", "GUIDED", True, False).percept("scout", "global_pos", *HOME)
    fleet.percept("scout", "victim", 4, -27.6, -48.5).mind("scout", time=1.0)
    assert fleet.model.lives.run == 1
    fleet.waits(10)
    assert (fleet.model.lives.run, known(fleet.model)) == (2, (1, 0, 1, True, False))
    assert [one.text for one in fleet.model.places.all.values()] == ["victim(4,-27.6,-48.5)"]


def test_a_model_that_stands_still_keeps_the_run_that_it_shows() -> None:
    fleet = flown()
    held = fleet.model.frozen()
    all_come(all_go(fleet).waits(5), "b2")
    assert held.agents["scout"].mind is not None
    assert len(held.actions.by_id) == 2
