"""Missions as actions: sent, read back, flown with progress, and never left half done in silence."""

from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.actions import mission_actions
from bridged.drivers.mavlink.actions.context import UNKNOWN_MISSION
from bridged.drivers.mavlink.actions.mission_items import Item, read_items
from bridged.simulation.vehicle.mission_items import Item as Stored
from schemas.wire.records import ActionStatus
from schemas.wire.terms import Term
from tests.bridged.sky import HOME, MISSION, Message, Passes, Sky, end_of
from tests.support.notes import identities

NEAR, FAR = [-27.603683, -48.518052, 20], [-27.6038, -48.5182, 15]
TOUR: list[Term] = [["takeoff", 0, 0, 10], NEAR, FAR]
LIMITED = MISSION + "    limits: {altitude: 30, radius: 100}\n"


def every(n: int, kind: str = "") -> Passes:
    """Loses every n-th message, or every n-th of a kind."""
    count = 0

    def passes(message: Message) -> bool:
        nonlocal count
        if not message.get_type().startswith(kind):
            return True
        count += 1
        return count % n != 0

    return passes


def held(sky: Sky) -> list[int]:
    """The commands that the vehicle stores."""
    return [item.command for item in sky.vehicle.autopilot.mission.items]


def waypoints(sky: Sky) -> list[tuple[Term, ...]]:
    return sky.beliefs("waypoint")


def test_a_mission_is_uploaded_counted_back_and_told_as_percepts(sky: Sky) -> None:
    sky.done("upload_mission", TOUR)
    assert held(sky) == [22, 16, 16]
    assert waypoints(sky) == [(1, "takeoff", 0.0, 0.0, 10.0), (2, "waypoint", *NEAR), (3, "waypoint", *FAR)]
    item = sky.vehicle.autopilot.mission.items[1]
    assert (item.x, item.y, item.z, item.frame) == (-276036830, -485180520, 20.0, dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT)


def test_a_mission_of_somebody_else_is_downloaded_and_replaces_what_was_believed(sky: Sky) -> None:
    sky.forward(lambda: sky.belief("home_pos"), "home")
    sky.do("upload_mission", TOUR)
    sky.vehicle.autopilot.mission.items.pop()
    sky.done("download_mission")
    assert waypoints(sky) == [(1, "takeoff", 0.0, 0.0, 10.0), (2, "waypoint", *NEAR)]


@pytest.mark.parametrize("n", [3, 4, 5])
def test_a_mission_passes_a_link_that_loses_every_few_messages_both_ways(sky: Sky, n: int) -> None:
    sky.wait(3)
    sky.hears_us, sky.we_hear = every(n, "MISSION_"), every(n + 1, "MISSION_")
    sky.done("upload_mission", TOUR)
    assert held(sky) == [22, 16, 16]
    sky.done("download_mission")
    assert len(waypoints(sky)) == 3
    sky.done("clear_mission")
    assert held(sky) == []
    assert waypoints(sky) == []


def test_an_upload_whose_acknowledgement_is_lost_is_read_back_and_compared(sky: Sky) -> None:
    sky.we_hear = lambda message: message.get_type() != "MISSION_ACK"
    assert end_of(sky.do("upload_mission", TOUR)) == ("succeeded", "")


def test_no_mission_is_started_after_an_upload_that_was_announced_and_whose_requests_are_lost(sky: Sky) -> None:
    sky.armed()
    sky.we_hear = lambda message: not message.get_type().startswith("MISSION_REQUEST")
    final = sky.do("upload_mission", TOUR)
    left = (
        "the upload was broken off after it was announced: what mission the vehicle holds now is not known; "
        "upload again or clear it"
    )
    said = f"the vehicle did not request the mission, announced 6 times; {left}"
    assert (final.state, final.reason) == ("failed", said)
    sky.we_hear = lambda message: True
    sky.do("arm_motors", True)
    assert end_of(sky.do("start_mission")) == ("refused", left)


def test_an_upload_that_falls_silent_says_what_it_leaves_and_no_mission_is_started_on_it(sky: Sky) -> None:
    sky.armed()
    sky.hears_us = lambda message: not (message.get_type() == "MISSION_ITEM_INT" and message.seq == 2)
    final = sky.do("upload_mission", TOUR)
    left = (
        "the upload was broken off at item 2 of 3: what mission the vehicle holds now is not known; "
        "upload again or clear it"
    )
    assert final.state in ("failed", "refused")
    assert final.reason.endswith(left)
    assert ("mission_broken", "") in identities(sky.driver.notes())
    sky.hears_us = lambda message: True
    sky.do("arm_motors", True)
    assert end_of(sky.do("start_mission")) == ("refused", left)
    sky.done("upload_mission", TOUR)
    assert ("mission_broken", "") not in identities(sky.driver.notes())


def test_a_bridge_killed_during_an_upload_starts_no_mission_before_it_knows_the_vehicles(tmp_path: Path) -> None:
    sky = Sky(tmp_path).armed()
    stored_by_another_station(sky, NEAR)
    sky.hears_us = lambda message: not (message.get_type() == "MISSION_ITEM_INT" and message.seq == 2)
    sky.begin("upload_mission", TOUR)
    sky.forward(lambda: any(getattr(one, "seq", 0) == 2 for one in sky.sent), "the second item")
    after = Sky(tmp_path, vehicle=sky.vehicle, clock=sky.clock)  # of the first bridge nothing is closed
    after._counter = sky._counter
    after.wait(12)  # the vehicle gives the upload up
    assert ("mission_broken", "") in identities(after.driver.notes())
    for name, arguments in (("start_mission", ()), ("set_mode", ("AUTO",))):
        final = after.do(name, *arguments)
        assert (final.state, final.reason.endswith(UNKNOWN_MISSION)) == ("refused", True)
    assert after.do("upload_mission", TOUR).state == "succeeded"
    again = Sky(tmp_path, vehicle=sky.vehicle, clock=sky.clock)
    assert ("mission_broken", "") not in identities(again.driver.notes())


def test_an_upload_that_could_not_be_remembered_does_not_begin(tmp_path: Path) -> None:
    sky = Sky(tmp_path).armed()
    (tmp_path / ".uav1.mission_broken.new").mkdir()
    final = sky.do("upload_mission", TOUR)
    assert final.state == "refused"
    assert final.reason.endswith("uav1.mission_broken cannot be written: Is a directory")
    assert held(sky) == []


def test_an_upload_that_is_cancelled_is_broken_off_at_the_vehicle_too(sky: Sky) -> None:
    sky.wait(3)
    sky.hears_us = lambda message: not (message.get_type() == "MISSION_ITEM_INT" and message.seq == 1)
    heard = sky.begin("upload_mission", TOUR)
    sky.forward(lambda: any(one.get_type() == "MISSION_ITEM_INT" for one in sky.sent), "the first item")
    sky.wait(1)
    final = sky.bridge.action_server.cancel("uav", heard[0].id)
    assert final.state == "cancelled"
    assert "the upload was broken off at item 1 of 3" in final.reason
    sky.wait(0.1)
    acks = [one for one in sky.sent if one.get_type() == "MISSION_ACK"]
    assert [one.type for one in acks] == [dialect.MAV_MISSION_OPERATION_CANCELLED]


def test_a_refused_mission_tells_why_in_words(sky: Sky) -> None:
    def refuse(message: Message) -> bool:
        if message.get_type() == "MISSION_COUNT":
            sky.downlink.append(dialect.MAVLink_mission_ack_message(1, 191, dialect.MAV_MISSION_NO_SPACE))
            return False
        return True

    sky.wait(2)
    sky.hears_us = refuse
    final = sky.do("upload_mission", TOUR)
    assert final.state == "refused"
    assert final.reason == "the vehicle refused the mission: the vehicle has no space for all items"
    assert ("mission_broken", "") not in identities(sky.driver.notes())


@pytest.mark.parametrize(
    ("asked", "action"), [("MISSION_COUNT", ("upload_mission", TOUR)), ("MISSION_SET_CURRENT", ("set_mission_item", 3))]
)
def test_a_refusal_for_another_station_is_not_ours(sky: Sky, asked: str, action: tuple[str, *tuple[Term, ...]]) -> None:
    def refuse_another(message: Message) -> bool:
        if message.get_type() == asked:
            sky.downlink.append(dialect.MAVLink_mission_ack_message(255, 190, dialect.MAV_MISSION_DENIED))
        return True

    sky.do("upload_mission", TOUR)
    sky.hears_us = refuse_another
    sky.done(*action)


@pytest.mark.parametrize(
    ("items", "reason"),
    [
        ([], "a mission is a list of items, each [Lat, Lon, Alt] or [Command, Lat, Lon, Alt, P1, P2, P3, P4]"),
        ([NEAR, [1, 2]], "item 2 of the mission: expected [Lat, Lon, Alt] or [Command, Lat, Lon, Alt, P1, P2, P3, P4]"),
        ([["hover", 0, 0, 5]], "item 1 of the mission: no command 'hover'; there is waypoint, takeoff, land"),
        ([[-97, 0, 5]], "item 1 of the mission: no place on earth: latitude -97, longitude 0"),
        ([["waypoint", "x", 0, 5]], "item 1 of the mission: expected a number, got 'x'"),
    ],
)
def test_a_mission_that_cannot_be_read_is_refused_with_its_item(sky: Sky, items: Term, reason: str) -> None:
    sky.wait(1)
    final = sky.do("upload_mission", items)
    assert final.state == "refused"
    assert final.reason.startswith(reason)
    assert not any(one.get_type() == "MISSION_COUNT" for one in sky.sent)


@pytest.mark.parametrize(
    ("item", "reason"),
    [
        ([-27.603683, -48.518052, 31], "item 2 of the mission: altitude 31 m is above the mission's limit of 30 m"),
        (
            [-27.613683, -48.518052, 20],
            "item 2 of the mission: 1075 m from home is outside the mission's limit of 100 m",
        ),
        (["takeoff", 0, 0, 40], "item 2 of the mission: altitude 40 m is above the mission's limit of 30 m"),
    ],
)
def test_every_item_keeps_the_limits_of_the_mission_file(tmp_path: Path, item: Term, reason: str) -> None:
    sky = Sky(tmp_path, mission=LIMITED)
    sky.forward(lambda: sky.belief("home_pos"), "home")
    assert end_of(sky.do("upload_mission", [["takeoff", 0, 0, 10], item, ["rtl"]])) == ("refused", reason)
    assert not any(one.get_type() == "MISSION_COUNT" for one in sky.sent)


def test_a_mission_of_somebody_else_is_read_before_it_is_flown_and_keeps_the_limits(tmp_path: Path) -> None:
    sky = Sky(tmp_path, mission=LIMITED).armed()
    sky.vehicle.autopilot.mission.store([
        Stored(0, 0, 16, (0, 0, 0, 0), 0, 0, 0.0), Stored(1, 3, 22, (0, 0, 0, 0), 0, 0, 50.0),
    ])  # fmt: skip
    final = sky.do("start_mission")
    assert final.state == "refused"
    assert final.reason == "item 1 of the mission: altitude 50 m is above the mission's limit of 30 m"


def started(sky: Sky, items: Term = TOUR) -> list[ActionStatus]:
    sky.done("upload_mission", items)
    sky.armed()
    return sky.begin("start_mission")


def at_item_2(sky: Sky) -> list[ActionStatus]:
    """The statuses of a mission that is flown, on the way to its second item."""
    heard = started(sky)
    sky.forward(lambda: (heard[-1].feedback or {}).get("item") == 2, "item 2")
    return heard


def test_a_mission_is_flown_from_the_ground_with_progress_until_its_last_item_is_reached(sky: Sky) -> None:
    heard = started(sky)
    sky.end(heard)
    assert (heard[-1].state, heard[-1].reason) == ("succeeded", "")
    assert heard[-1].feedback["reached"] == heard[-1].feedback["items"] == 3
    running = [one.feedback for one in heard if one.state == "running" and "item" in one.feedback]
    assert [one["item"] for one in running] == sorted(one["item"] for one in running)
    assert {one["item"] for one in running} == {1, 2, 3}
    assert any("distance" in one for one in running)
    reached = sky.told("item_reached")
    assert reached == [(1,), (2,), (3,)]
    sky.wait(3)
    assert sky.belief("override") is None, "leaving AUTO at its end is the mission's own doing"
    assert sky.driver.overridden == ""


def test_a_mission_is_flown_again_from_its_first_item_when_it_is_over(sky: Sky) -> None:
    heard = started(sky)
    sky.end(heard)
    again = sky.begin("start_mission")
    took = sky.forward(lambda: again[-1].final, "the end")
    assert again[-1].state == "succeeded", again[-1].reason
    assert took > 8


def test_a_mission_that_ends_on_the_ground_succeeds_with_the_motors_stopped(sky: Sky) -> None:
    heard = started(sky, [["takeoff", 0, 0, 5], ["land", 0, 0, 0]])
    assert sky.end(heard).state == "succeeded", heard[-1].reason
    sky.wait(3)
    assert sky.belief("state") == ("AUTO", True, False)


@pytest.mark.parametrize(
    "we_hear",
    [every(3), every(4), lambda message: message.get_type() != "MISSION_ITEM_REACHED"],
    ids=["all but every third message", "all but every fourth", "no MISSION_ITEM_REACHED"],
)
def test_a_mission_is_seen_to_its_end_although_messages_are_lost(sky: Sky, we_hear: Passes) -> None:
    heard = started(sky)
    sky.we_hear = we_hear
    assert sky.end(heard).state == "succeeded", heard[-1].reason


def test_a_pilot_who_changes_the_mode_ends_the_mission_with_the_reason(sky: Sky) -> None:
    heard = at_item_2(sky)
    sky.vehicle.autopilot.set_mode(5)
    assert sky.end(heard, 10).state == "failed"
    said = "the mode became LOITER, which nobody here asked for (pilot, ground station or failsafe)"
    assert heard[-1].reason.startswith(f"{said} before the end of the mission (item 1 of 3)")
    sky.wait(2)
    assert sky.belief("override") == ("LOITER",)
    assert sky.do("goto", *NEAR).state == "refused"


def test_a_mission_whose_vehicle_disarms_before_its_end_fails(sky: Sky) -> None:
    heard = at_item_2(sky)
    sky.vehicle.autopilot.disarm(force=True)
    assert sky.end(heard, 10).state == "failed"
    assert heard[-1].reason.startswith("the vehicle disarmed before the end of the mission")


def test_a_mission_that_is_cancelled_holds_the_vehicle(sky: Sky) -> None:
    heard = at_item_2(sky)
    assert sky.bridge.action_server.cancel("uav", heard[0].id).state == "cancelled"
    sky.forward(lambda: sky.belief("state") == ("GUIDED", True, True), "GUIDED", 5)
    sky.wait(3)
    assert sky.vehicle.autopilot.motion.course[0] < 0.3
    assert sky.belief("override") is None


def test_a_mission_that_is_not_done_in_time_says_where_it_is(sky: Sky) -> None:
    sky.do("upload_mission", TOUR)
    final = sky.armed().do("start_mission", deadline=10.0)
    assert final.state == "timed_out"
    assert "it waited for the end of the mission; it is at item" in final.reason


def test_a_mission_is_started_armed_and_needs_items(sky: Sky) -> None:
    sky.wait(1)
    assert sky.do("start_mission").reason.startswith("a mission is started armed; the vehicle is not armed")
    sky.armed()
    assert end_of(sky.do("start_mission")) == ("refused", "the vehicle has no mission; upload one")


def test_a_mission_on_the_ground_without_a_takeoff_fails_in_words(sky: Sky) -> None:
    heard = started(sky, [NEAR])
    assert sky.end(heard).state == "failed"


def test_the_next_item_is_set_and_one_that_is_not_there_is_refused(sky: Sky) -> None:
    sky.do("upload_mission", TOUR)
    sky.done("set_mission_item", 3)
    assert sky.vehicle.autopilot.mission.current == 3
    assert end_of(sky.do("set_mission_item", 9)) == ("refused", "no item 9; the mission has 3")


def test_an_item_that_a_mission_of_somebody_else_does_not_have_fails_in_words(sky: Sky) -> None:
    sky.wait(3)
    final = sky.do("set_mission_item", 9)
    assert (final.state, final.reason) == (
        "failed",
        "the vehicle did not go to item 9; does its mission have that many items?",
    )


def test_one_action_at_a_time_speaks_the_mission_protocol(sky: Sky) -> None:
    sky.wait(3)
    sky.hears_us = lambda message: not message.get_type().startswith("MISSION_")
    sky.begin("upload_mission", TOUR)
    sky.wait(0.5)
    final = sky.do("download_mission")
    assert final.state == "refused"
    assert final.reason == "busy: upload_mission is exchanging the mission with the vehicle"


def test_items_may_be_named_structures_as_mavros_has_them() -> None:
    said = {
        "frame": 3, "command": 16, "is_current": False, "autocontinue": True, "param1": 2.0, "param2": 0.0,
        "param3": 0.0, "param4": 0.0, "x_lat": -27.6, "y_long": -48.5, "z_alt": 20.0,
    }  # fmt: skip
    assert read_items([said], 0) == (Item(16, 3, (2.0, 0.0, 0.0, 0.0), -276000000, -485000000, 20.0),)
    with pytest.raises(ValueError, match="item 1 of the mission: no field `speed`; there is command, latitude"):
        read_items([{"speed": 3}], 3)


def test_the_place_of_home_is_sent_as_item_zero(sky: Sky) -> None:
    sky.forward(lambda: sky.belief("home_pos"), "home")
    sky.do("upload_mission", TOUR)
    items = [one for one in sky.sent if one.get_type() == "MISSION_ITEM_INT"]
    assert (items[0].seq, items[0].x, items[0].y) == (0, round(HOME.lat * 1e7), round(HOME.lon * 1e7))


def stored_by_another_station(sky: Sky, *items: Term) -> None:
    """Another ground station stores a mission, as the vehicle has it then."""
    copter = sky.vehicle.autopilot
    stored = [
        Stored(seq, 3, 16, (0, 0, 0, 0), round(one[0] * 1e7), round(one[1] * 1e7), one[2])
        for seq, one in enumerate(items, 1)
        if isinstance(one, list)
    ]
    copter.mission.store([Stored(0, 0, 16, (0, 0, 0, 0), 0, 0, 0.0), *stored])
    copter.count_mission(len(items) + 1)


def test_a_mission_that_jumps_is_over_only_when_the_vehicle_says_so(sky: Sky) -> None:
    sky.flying()
    sky.do("upload_mission", [NEAR, FAR, ["MAV_CMD_DO_JUMP", 0, 0, 0, 1, 2]])
    heard = sky.begin("start_mission")
    sky.end(heard, 400)
    assert (heard[-1].state, heard[-1].reason) == ("succeeded", "")
    reached = sky.told("item_reached")
    assert reached == [(1,), (2,)] * 3
    assert sky.vehicle.autopilot.mission.complete


def test_a_pilot_right_after_the_end_of_a_mission_is_a_pilot(sky: Sky) -> None:
    heard = started(sky)
    assert sky.end(heard).state == "succeeded", heard[-1].reason
    sky.wait(1)
    sky.vehicle.autopilot.set_mode(5)
    sky.forward(lambda: sky.belief("override"), "the override", 5)
    assert sky.do("return_to_launch").state == "refused"
    assert sky.vehicle.autopilot.mode.name == "LOITER"


def test_a_mission_that_another_station_stored_since_ours_is_the_one_that_is_judged(tmp_path: Path) -> None:
    sky = Sky(tmp_path, mission=LIMITED).flying()
    sky.done("upload_mission", [NEAR, FAR])
    stored_by_another_station(sky, NEAR, [*FAR[:2], 50])
    final = sky.do("start_mission")
    assert final.reason == "item 2 of the mission: altitude 50 m is above the mission's limit of 30 m"
    assert final.state == "refused"
    assert sky.vehicle.autopilot.mode.name == "GUIDED"
    assert [one[4] for one in waypoints(sky)] == [20.0, 50.0], "what the vehicle holds is told"


@pytest.mark.parametrize("action", [("upload_mission", [FAR]), ("clear_mission",)])
def test_a_mission_in_flight_is_neither_replaced_nor_cleared(sky: Sky, action: tuple[str, *tuple[Term, ...]]) -> None:
    heard = at_item_2(sky)
    final = sky.do(*action)
    assert final.reason == "start_mission is flying the vehicle's mission; cancel it first"
    assert final.state == "refused"
    assert sky.end(heard).state == "succeeded", heard[-1].reason
    final = sky.do(*action)
    assert final.reason == "the vehicle is flying its mission (AUTO); set another mode first"
    sky.done("set_mode", "GUIDED")
    sky.done(*action)


@pytest.mark.parametrize("items", [[NEAR, FAR, NEAR, FAR], []])
def test_a_mission_that_another_station_changes_in_flight_fails_in_words(sky: Sky, items: list[Term]) -> None:
    heard = at_item_2(sky)
    stored_by_another_station(sky, *items)
    assert sky.end(heard, 5).state == "failed"
    assert heard[-1].reason.startswith("the vehicle's mission was changed by others while it was flown")


def test_an_acknowledgement_of_an_upload_before_is_not_taken_for_that_of_this_one(sky: Sky) -> None:
    sky.done("upload_mission", [NEAR, FAR])
    identity = sky.driver.identity
    late = dialect.MAVLink_mission_ack_message(identity.system, identity.component, dialect.MAV_MISSION_ACCEPTED)
    sky.hears_us = lambda message: message.get_type() != "MISSION_COUNT"
    heard = sky.begin("upload_mission", [FAR, NEAR])
    sky.downlink.append(late)
    sky.wait(0.3)
    assert not heard[-1].final
    sky.hears_us = lambda message: True
    assert sky.end(heard, 10).state == "succeeded", heard[-1].reason
    assert [item.z for item in sky.vehicle.autopilot.mission.items] == [15, 20]


def test_a_mission_whose_start_no_heartbeat_shows_for_a_while_is_not_said_to_be_broken_off(sky: Sky) -> None:
    sky.armed()
    assert sky.do("upload_mission", TOUR).state == "succeeded"
    sky.we_hear = lambda message: message.get_type() != "HEARTBEAT"
    heard = sky.begin("start_mission")
    sky.wait(4.5)
    sky.we_hear = lambda message: True
    sky.forward(lambda: heard[-1].final, "the end of the mission")
    assert (heard[-1].state, heard[-1].reason) == ("succeeded", "")


def test_auto_is_set_only_on_a_whole_mission_within_the_limits(tmp_path: Path) -> None:
    sky = Sky(tmp_path, mission=LIMITED).flying()
    stored_by_another_station(sky, NEAR, [*FAR[:2], 50])
    final = sky.do("set_mode", "AUTO")
    assert final.reason == "item 2 of the mission: altitude 50 m is above the mission's limit of 30 m"
    assert (final.state, sky.vehicle.autopilot.mode.name) == ("refused", "GUIDED")
    stored_by_another_station(sky, NEAR, FAR)
    sky.done("set_mode", "AUTO")


def test_auto_is_not_set_on_what_an_upload_that_broke_off_has_left(sky: Sky) -> None:
    sky.flying()
    sky.hears_us = lambda message: not (message.get_type() == "MISSION_ITEM_INT" and message.seq == 2)
    assert sky.do("upload_mission", TOUR).state != "succeeded"
    sky.hears_us = lambda message: True
    final = sky.do("set_mode", "AUTO")
    assert final.state == "refused"
    assert final.reason.startswith("the upload was broken off at item 2 of 3")
    assert sky.vehicle.autopilot.mode.name == "GUIDED"


TERRAIN = {"frame": 10, "command": 16, "x_lat": NEAR[0], "y_long": NEAR[1], "z_alt": 20.0}
MOVES_HOME: Term = ["MAV_CMD_DO_SET_HOME", -27.6050, -48.5200, 0]


def test_items_whose_limits_cannot_be_kept_are_refused_under_limits(tmp_path: Path) -> None:
    sky = Sky(tmp_path, mission=LIMITED)
    sky.forward(lambda: sky.belief("home_pos"), "home")
    final = sky.do("upload_mission", [NEAR, MOVES_HOME])
    said = "it moves home, from where the mission's limits are measured"
    assert (final.state, final.reason) == ("refused", f"item 2 of the mission: {said}")
    [high] = read_items([TERRAIN], 3)
    flight = sky.driver.flight  # the manifest that ships has no items with frames
    assert mission_actions.outside(flight, (high,)).startswith(
        "item 1 of the mission: an altitude above terrain cannot be"
    )


def test_without_limits_home_may_be_moved(sky: Sky) -> None:
    sky.wait(1)
    sky.done("upload_mission", [NEAR, MOVES_HOME])


def test_a_mission_of_which_nothing_is_flown_says_so(sky: Sky) -> None:
    sky.do("upload_mission", [["MAV_CMD_DO_SET_SERVO", 0, 0, 0, 9, 1900]])
    final = sky.armed().do("start_mission")
    assert (final.state, final.reason) == ("refused", "nothing in the vehicle's mission is flown; upload one")


@pytest.mark.parametrize(("last", "height"), [("rtl", 20.0), ("rtl", 5.0), ("land", 6.0)])
def test_motors_that_stop_aloft_at_the_last_item_are_no_end_of_a_mission(sky: Sky, last: str, height: float) -> None:
    heard = started(sky.flying(height), [[*NEAR[:2], height], [last, 0, 0, 0]])
    sky.forward(lambda: (heard[-1].feedback or {}).get("item") == 2, "the last item")
    sky.vehicle.autopilot.disarm(force=True)
    assert sky.end(heard, 20).state == "failed"
    assert heard[-1].reason.startswith("the motors stopped in the air at the last item")
