"""The model of a fleet, from records."""

from pathlib import Path

from argosy.fleet_model.model import TRACK, FleetModel
from schemas.mission.model import load_mission
from schemas.wire import keys
from schemas.wire.mind_records import ActivityEvent
from schemas.wire.records import BoardServices, Perception, Queue
from tests.argosy.fleet_model.fleet import FLEET, HOME, Fleet, rescue

MISSION = load_mission(Path(__file__).parents[3] / "missions" / "search_and_rescue.yaml")


def texts(fleet: Fleet) -> list[str]:
    return [f"{entry.who}: {entry.text}" for entry in fleet.model.timeline.entries]


def test_a_fleet_without_a_mission_is_known_by_its_tokens_and_by_what_its_bridges_tell() -> None:
    model = rescue().model
    assert (list(model.agents), list(model.robots), list(model.boards)) == (["scout"], ["uav1"], ["pi1"])
    assert model.agents["scout"].robot == "uav1"
    assert model.robots["uav1"].agents == ("scout",)
    assert model.robots["uav1"].seen.mode == "GUIDED"


def test_members_stand_in_the_order_of_their_numbers() -> None:
    fleet = Fleet()
    for number in (10, 2, 1):
        fleet.comes(f"uav{number}", "bridged")
    assert list(fleet.model.robots) == ["uav1", "uav2", "uav10"]


def test_a_mission_says_who_should_be_there() -> None:
    model = Fleet(MISSION).comes("scout", "agentd").model
    assert model.agents["scout"].there
    assert model.agents["rescuer1"].standing == "missing"
    assert model.agents["rescuer1"].robot == "uav2"
    assert [note.code for note in model.boards["pi3"].notes] == ["missing"]


def test_a_service_list_tells_on_which_board_an_agent_lives_whichever_is_heard_first() -> None:
    fleet = rescue()
    fleet.model.services(keys.services(FLEET, "pi1"), BoardServices(board="pi1", agents={"scout": (), "late": ()}))
    assert fleet.model.agents["scout"].board == "pi1"
    assert fleet.comes("late", "agentd").model.agents["late"].board == "pi1"


def test_what_is_of_another_fleet_or_no_key_of_ours_changes_nothing_but_its_name_is_known() -> None:
    fleet = rescue()
    fleet.model.token(keys.alive("other", "uav9", "bridged", "b"), alive=True)
    fleet.model.token("nonsense", alive=True)
    fleet.model.tick()
    assert list(fleet.model.robots) == ["uav1"]
    assert fleet.model.other_fleets == {"other"}


def test_who_comes_and_goes_stands_in_the_timeline_and_stays_to_be_seen_as_gone() -> None:
    fleet = rescue().waits(2).goes("scout", "agentd")
    agent = fleet.model.agents["scout"]
    assert not agent.there
    assert agent.since == fleet.at
    assert texts(fleet)[-1] == "scout: agentd is gone"


def test_a_daemon_that_tells_nothing_is_silent() -> None:
    fleet = rescue().waits(6)
    assert fleet.model.agents["scout"].standing == "silent"
    assert not fleet.model.agents["scout"].well


def test_a_mind_that_does_not_answer_is_silent_since_it_was_last_heard_and_until_it_answers() -> None:
    fleet = rescue().mind("scout", "+!search")
    heard = fleet.at
    fleet.waits(4).model.mind_unanswered("scout")
    assert fleet.model.agents["scout"].silent is None
    fleet.waits(2).model.mind_unanswered("scout")
    assert fleet.model.agents["scout"].silent == heard
    assert fleet.model.agents["scout"].age(fleet.at) == 6
    fleet.mind("scout", "+!search")
    assert fleet.model.agents["scout"].silent is None
    assert texts(fleet)[-1] == "scout: its mind answers again, after 6 s"


def test_no_mind_counts_as_silent_because_the_router_is_away() -> None:
    fleet = rescue().mind("scout")
    fleet.model.router(up=False)
    fleet.waits(60).model.mind_unanswered("scout")
    fleet.model.router(up=True)
    fleet.model.mind_unanswered("scout")
    assert fleet.model.agents["scout"].silent is None
    assert fleet.model.agents["scout"].there
    assert texts(fleet)[-2:] == [
        "router: does not answer; the view shows the last known state",
        "router: answers again, after 60.0 s",
    ]


def test_nobody_has_gone_as_long_as_the_router_is_away_or_has_just_come_back() -> None:
    fleet = rescue()
    fleet.model.router(up=False)
    fleet.goes("scout", "agentd").waits(60)
    assert fleet.model.agents["scout"].there
    fleet.model.router(up=True)
    assert fleet.waits(4).model.agents["scout"].there
    assert not fleet.waits(2).model.agents["scout"].there


def test_a_robot_of_which_nothing_is_heard_is_stale_and_says_how_old_it_is() -> None:
    fleet = rescue()
    robot = fleet.model.robots["uav1"]
    assert not robot.stale(fleet.at)
    fleet.waits(3.5)
    assert robot.stale(fleet.at)
    assert robot.age(fleet.at) == 3.5
    fleet.told("uav1", "bridged")
    assert not robot.stale(fleet.at)


def test_a_lost_vehicle_is_stale_however_well_its_bridge_is() -> None:
    fleet = rescue().percept("scout", "state", "", False, False).told("uav1", "bridged")
    assert fleet.model.robots["uav1"].stale(fleet.at)
    assert fleet.model.robots["uav1"].seen.armed


def test_an_order_of_the_operator_is_known_by_the_health_of_the_bridge() -> None:
    fleet = rescue().told("uav1", "bridged", ordered="hold")
    assert fleet.model.robots["uav1"].seen.operator == "hold"
    assert fleet.told("uav1", "bridged").model.robots["uav1"].seen.operator == ""


def test_an_action_that_bridge_and_agent_tell_of_stands_once_in_the_timeline() -> None:
    fleet = rescue().action("scout", 7, "goto", "accepted", -27.6035, -48.5182, 20)
    assert [one.text for one in fleet.model.actions.open("scout")] == ["goto(-27.6035,-48.5182,20)"]
    fleet.activity("scout", ActivityEvent(kind="action", id="scout:1:7", text="goto(-27.6035,-48.5182,20)"))
    fleet.waits(2).action("scout", 7, "goto", "succeeded", -27.6035, -48.5182, 20)
    fleet.activity(
        "scout", ActivityEvent(kind="outcome", id="scout:1:7", text="goto(-27.6035,-48.5182,20)", state="succeeded")
    )
    assert [text for text in texts(fleet) if "goto" in text] == [
        "scout: goto(-27.6035,-48.5182,20)",
        "scout: goto(-27.6035,-48.5182,20) succeeded after 2.0 s",
    ]
    assert fleet.model.actions.open() == []


def test_an_activity_event_has_the_time_at_which_it_happened_not_was_published() -> None:
    fleet = rescue().activity("scout", ActivityEvent(kind="print", text="hello", time=99.0), now=100.0, speed=5.0)
    entry = fleet.model.timeline.entries[-1]
    assert (entry.at, entry.text) == (fleet.at - 0.2, "hello")


def test_left_out_events_are_reported() -> None:
    fleet = rescue().activity("scout", left_out=3)
    assert texts(fleet)[-1] == "scout: 3 of its activity events were not published: too many at a time"


def test_a_message_is_one_entry_whoever_reports_it_first() -> None:
    fleet = rescue()
    sent = ActivityEvent(kind="sent", id="m1", other="rescuer1", performative="tell", text="victim(1)")
    fleet.activity("scout", sent).waits(1)
    (message,) = fleet.model.messages.newest()
    assert (message.undelivered, message.sent, message.received) == ("", fleet.at - 1, None)
    fleet.activity(
        "rescuer1", ActivityEvent(kind="received", id="m1", other="scout", performative="tell", text="victim(1)")
    )
    (message,) = fleet.model.messages.newest()
    assert (message.sender, message.receiver, message.content) == ("scout", "rescuer1", "victim(1)")
    assert message.received == fleet.at


def test_a_broadcast_is_a_message_to_each_and_a_lost_one_has_a_reason() -> None:
    fleet = rescue()
    for receiver in ("a", "b"):
        fleet.activity("scout", ActivityEvent(kind="sent", id="m1", other=receiver, performative="tell", text="x"))
    fleet.activity(
        "scout", ActivityEvent(kind="undelivered", id="m1", other="b", performative="tell", text="x", reason="expired")
    )
    assert {one.receiver: one.undelivered for one in fleet.model.messages.newest()} == {"a": "", "b": "expired"}
    assert texts(fleet)[-1] == "scout: not delivered to b: tell x: expired"


def test_victims_and_targets_are_places_and_numbers_that_are_no_place_are_not() -> None:
    fleet = rescue().percept("scout", "victim", 3, -27.6035, -48.5182, key=(0,))
    fleet.percept("scout", "velocity", 0.1, -0.2, 3.0).percept("scout", "gps", 3, 10)
    fleet.action("scout", 1, "goto", "running", -27.6030, -48.5180, 20).action("scout", 2, "takeoff", "running", 20)
    places = fleet.model.places.all
    assert {one.name: one.position for one in places.values()} == {
        "victim": (-27.6035, -48.5182),
        "goto": (-27.6030, -48.5180),
    }
    fleet.percept("scout", "victim", 3, -27.6036, -48.5182, key=(0,))
    fleet.percept("scout", "victim", 3, -27.6036, -48.5182, key=(0,), update="remove")
    fleet.action("scout", 1, "goto", "failed", -27.6030, -48.5180, 20, reason="wind")
    assert [(one.name, one.present, one.state) for one in places.values()] == [
        ("goto", False, "failed"),
        ("victim", False, ""),
    ]


def test_a_percept_by_hand_is_told_and_moves_no_robot() -> None:
    fleet = rescue()
    by_hand = Perception(name="", parameters=(0.0,))
    fleet.model.percept(keys.percept_by_hand(FLEET, "scout", "altitude"), by_hand)
    assert fleet.model.robots["uav1"].seen.altitude == 20.0
    assert texts(fleet)[-1] == "scout: a percept by hand: replace altitude(0)"


def test_a_percept_that_replaces_all_of_its_name_leaves_one_place_present() -> None:
    fleet = rescue().percept("scout", "goal", -27.6035, -48.5182).percept("scout", "goal", -27.6036, -48.5182)
    assert [one.present for one in fleet.model.places.all.values()] == [False, True]


def test_mail_that_waits_for_an_agent_is_counted_over_all_boards() -> None:
    queues = (Queue(box="inbox", sender="a", receiver="scout", messages=3),)
    fleet = rescue().comes("pi2", "commd").mail("pi1", *queues)
    fleet.mail("pi2", Queue(box="outbox", sender="b", receiver="scout", messages=1, state="pi1 is away"))
    assert fleet.model.mail_for("scout") == 4
    fleet.model.mailboxes(keys.mailboxes(FLEET, "pi2"), None, "its commd does not answer")
    assert fleet.model.boards["pi2"].problem == "its commd does not answer"
    assert fleet.model.boards["pi2"].waiting() == 1


def test_the_timeline_answers_what_came_since_a_number_and_keeps_the_newest() -> None:
    fleet = rescue()
    before = fleet.model.timeline.number
    fleet.activity("scout", *(ActivityEvent(kind="print", text=str(number)) for number in range(6000)))
    new = fleet.model.timeline.since(before)
    assert len(new) == 5000
    assert new[-1].text == "5999"
    assert new[-1].number == fleet.model.timeline.number == before + 6000
    assert [entry.text for entry in fleet.model.timeline.since(before + 5998)] == ["5998", "5999"]


def test_everything_that_may_grow_is_bounded() -> None:
    fleet = rescue()
    for number in range(2100):
        fleet.percept("scout", "global_pos", HOME[0] + number * 1e-6, HOME[1])
        fleet.percept("scout", "seen", number, HOME[0], HOME[1], update="add")
        fleet.activity("scout", ActivityEvent(kind="sent", id=str(number), other="a", performative="tell", text="x"))
    for number in range(700):
        fleet.model.token(keys.alive(FLEET, f"a{number}", "agentd", "b"), alive=True)
    fleet.model.tick()
    model: FleetModel = fleet.model
    assert len(model.robots["uav1"].seen.track.points) <= TRACK
    assert len(model.places.all) == 1000
    assert len(model.messages) == 2000
    assert len(model.agents) == 500
    assert model.roster.forgotten > 0


def test_strangers_push_no_member_of_the_mission_out() -> None:
    fleet = Fleet(MISSION)
    for number in range(600):
        fleet.model.token(keys.alive(FLEET, f"a{number}", "agentd", "b"), alive=True)
    fleet.model.tick()
    assert list(fleet.model.agents)[: len(MISSION.agents)] == list(MISSION.agents)
    assert len(fleet.model.agents) == 500 + len(MISSION.agents)
