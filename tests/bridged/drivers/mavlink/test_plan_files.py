"""Plan files of ground stations: what QGroundControl and Mission Planner write is read, flown and written again."""

import json
import math
import os
import random
import re
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavwp
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.actions.mission_items import MAX_ITEMS, Item
from bridged.drivers.mavlink.plan_files import BadPlan, find_plan, parse_plan, read_plan, write_plan
from bridged.simulation.vehicle.kinds import KINDS, AutopilotName
from bridged.simulation.vehicle.vehicle import Vehicle
from tests.bridged.sky import HOME as START
from tests.bridged.sky import MISSION, Sky
from tests.support.amount import some_of

LIMITED = MISSION + "    limits: {altitude: 30, radius: 100}\n"
ON_LAND, NEAR = (-27.604033, -48.518363), (-27.603683, -48.518052)
WPL = """\
QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t-27.60403300\t-48.51836300\t21.000000\t1
1\t0\t3\t22\t0.00000000\t0.00000000\t0.00000000\t0.00000000\t0.00000000\t0.00000000\t10.000000\t1
2\t0\t3\t16\t2.00000000\t0.00000000\t0.00000000\t0.00000000\t-27.60368300\t-48.51805200\t20.000000\t1
3\t0\t3\t177\t2.00000000\t3.00000000\t0.00000000\t0.00000000\t0.00000000\t0.00000000\t0.000000\t1
4\t0\t3\t20\t0.00000000\t0.00000000\t0.00000000\t0.00000000\t0.00000000\t0.00000000\t0.000000\t1
"""


def simple(command: int, *params: float | None, frame: int = 3, jump: int = 1, **more: object) -> dict[str, object]:
    """Return a SimpleItem as QGroundControl writes it."""
    return {
        "AMSLAltAboveTerrain": None, "Altitude": params[-1], "AltitudeMode": 1, "autoContinue": True,
        "command": command, "doJumpId": jump, "frame": frame, "params": list(params), "type": "SimpleItem",
    } | more  # fmt: skip


def survey(*items: object, kind: str = "survey") -> dict[str, object]:
    """Return a ComplexItem with the items that were generated for it."""
    generated = {"CameraCalc": {"version": 2}, "Items": list(items), "VisualTransectPoints": [[1, 2]], "version": 2}
    return {
        "TransectStyleComplexItem": generated, "angle": 0, "complexItemType": kind, "polygon": [],
        "type": "ComplexItem", "version": 5,
    }  # fmt: skip


def plan(*items: object, **parts: object) -> str:
    """Return the text of a plan of QGroundControl."""
    return json.dumps(
        {
            "fileType": "Plan", "groundStation": "QGroundControl", "version": 1,
            "geoFence": {"circles": [], "polygons": [], "version": 2},
            "rallyPoints": {"points": [], "version": 2},
            "mission": {
                "cruiseSpeed": 15, "firmwareType": 3, "globalPlanAltitudeMode": 1, "hoverSpeed": 5, "items": items,
                "plannedHomePosition": [*ON_LAND, 21], "vehicleType": 2, "version": 2,
            },
        }
        | parts,
        indent=4,
    )  # fmt: skip


TAKEOFF = simple(22, 0, 0, 0, None, *ON_LAND, 10)
THERE = simple(16, 0, 0, 0, None, *NEAR, 20, jump=2)
HOME = simple(20, 0, 0, 0, 0, 0, 0, 0, frame=2, jump=3)


def commands(items: tuple[Item, ...]) -> list[int]:
    return [item.command for item in items]


def test_a_list_of_waypoints_is_read_as_pymavlink_reads_it_and_home_is_no_item(tmp_path: Path) -> None:
    path = tmp_path / "m.waypoints"
    path.write_text(WPL)
    loader = mavwp.MAVWPLoader()
    assert loader.load(str(path)) == 5
    read = read_plan(path).items
    assert len(read) == 4
    for seq, item in enumerate(read, 1):
        theirs = loader.item(seq)
        assert (item.command, item.frame, item.z) == (theirs.command, theirs.frame, theirs.z)
        assert (item.x, item.y) == (round(theirs.x * 1e7), round(theirs.y * 1e7))
        assert item.parameters == (theirs.param1, theirs.param2, theirs.param3, theirs.param4)


def test_a_plan_of_qgroundcontrol_is_read_with_what_was_generated_for_its_survey() -> None:
    line = [
        simple(16, 0, 0, 0, None, -27.6037, -48.518, 20, jump=5),
        simple(206, 25, 0, 1, 0, 0, 0, 0, frame=2, jump=6),
    ]
    items = parse_plan(plan(TAKEOFF, THERE, survey(*line), survey(line[0], kind="CorridorScan"), HOME)).items
    assert commands(items) == [22, 16, 16, 206, 16, 20]
    assert (items[1].x, items[1].y, items[1].z, items[1].frame) == (-276036830, -485180520, 20.0, 3)
    assert math.isnan(items[1].parameters[3])
    assert items[3].parameters == (25, 0, 1, 0)
    assert items[5].frame == dialect.MAV_FRAME_MISSION


def test_a_jump_names_its_target_by_id_and_gets_the_number_that_the_target_has_in_the_mission() -> None:
    jump = simple(177, 2, 3, 0, 0, 0, 0, 0, frame=2, jump=9)
    inside = survey(simple(16, 0, 0, 0, None, *NEAR, 20, jump=5), simple(16, 0, 0, 0, None, *NEAR, 25, jump=6))
    items = parse_plan(plan(TAKEOFF, inside, THERE, jump)).items
    assert items[4].parameters == (4.0, 3.0, 0.0, 0.0)


FIELD = [[-27.6, -48.52], [-27.6, -48.515], [-27.61, -48.515], [-27.61, -48.52]]
POND = {"inclusion": False, "circle": {"center": [-27.6055, -48.5184], "radius": 30.5}, "version": 1}
FENCE = {
    "polygons": [{"inclusion": True, "polygon": FIELD, "version": 1}],
    "circles": [POND],
    "breachReturn": [-27.604, -48.518, 20],
    "version": 2,
}
RALLY = {"points": [[-27.6041, -48.5185, 25]], "version": 2}


def test_fence_and_rally_points_are_items_of_lists_of_their_own() -> None:
    read = parse_plan(plan(THERE, geoFence=FENCE, rallyPoints=RALLY))
    assert [item.command for item in read.fence] == [5001] * 4 + [5004]
    assert (read.fence[0].parameters[0], read.fence[0].x, read.fence[0].y) == (4.0, -276000000, -485200000)
    assert (read.fence[4].parameters[0], read.fence[4].x) == (30.5, -276055000)
    assert [(item.command, item.x, item.z, item.frame) for item in read.rally] == [(5100, -276041000, 25.0, 3)]
    assert read.remark == "not taken from the file: the breach return point"
    assert parse_plan(plan(THERE)) == parse_plan(plan(THERE, geoFence={"circles": [], "polygons": []}))


@pytest.mark.parametrize(
    ("fence", "said"),
    [
        (
            {"polygons": [{"inclusion": True, "polygon": FIELD[:2]}]},
            ">= 3 - at `$.geoFence.polygons[0].polygon`",
        ),
        ({"polygons": [{"polygon": FIELD}]}, "missing required field `inclusion` - at `$.geoFence.polygons[0]`"),
        ({"circles": [POND, {}]}, "missing required field `inclusion` - at `$.geoFence.circles[1]`"),
        (
            {"polygons": [{"inclusion": True, "polygon": [[-95, 0], *FIELD]}]},
            "Expected `float` >= -90.0 - at `$.geoFence.polygons[0].polygon[0][0]`",
        ),
        ({"circles": {}}, "Expected `array`, got `object` - at `$.geoFence.circles`"),
    ],
)
def test_a_fence_that_cannot_be_understood_is_refused_by_its_place(fence: dict[str, Any], said: str) -> None:
    with pytest.raises(BadPlan) as bad:
        parse_plan(plan(THERE, geoFence=fence))
    assert str(bad.value).endswith(said)


SCAN, LANDING = ({"type": "ComplexItem", "complexItemType": kind} for kind in ("StructureScan", "fwLandingPattern"))
MISTAKES = {
    "neither": ("take me home", "expected a plan of QGroundControl"),
    "no json": ('{"fileType": ', "of version 1, its mission of version 2: Input data was"),
    "other file": (plan(THERE, fileType="Mission"), "Invalid enum value 'Mission' - at `$.fileType`"),
    "newer plan": (plan(THERE, version=2), "Invalid enum value 2 - at `$.version`"),
    "no fields": ("{}", "missing required field `fileType`"),
    "no list": (plan(mission={"version": 2}), "missing required field `items` - at `$.mission`"),
    "no mission": (plan(THERE, mission=[]), "Expected `object`, got `array` - at `$.mission`"),
    "older mission": (plan(mission={"version": 1}), "Invalid enum value 1 - at `$.mission.version`"),
    "no items": (plan(), "it has no items"),
    "item": (plan(THERE, 5), "Expected `object`, got `int` - at `$.mission.items[1]`"),
    "its type": (plan({"type": "Other"}), "Invalid value 'Other' - at `$.mission.items[0].type`"),
    "structure scan": (plan(THERE, SCAN), "item 2 (StructureScan): the file does not hold"),
    "landing": (plan(LANDING), "item 1 (fwLandingPattern): the file"),
    "nested": (plan(survey(survey(THERE))), "at `$.mission.items[0].TransectStyleComplexItem.Items[0].type`"),
    "generated": (plan(survey(THERE, simple(16, 1, 2))), "at `$.mission.items[0].TransectStyleComplexItem.Items[1].p"),
    "text": (plan(simple(16, 0, 0, 0, 0, "x", 0, 0)), "| null`, got `str` - at `$.mission.items[0].params[4]`"),
    "command": (plan(TAKEOFF | {"command": "22"}), "Expected `int`, got `str` - at `$.mission.items[0].command`"),
    "frame": (plan(TAKEOFF | {"frame": 7}), "item 1: frame 7 is neither above home"),
    "no place": (plan(simple(16, 0, 0, 0, 0, None, 0, 10)), "item 1: expected latitude, -90 to 90, got nan"),
    "no altitude": (plan(simple(16, 0, 0, 0, 0, 1, 2, None)), "item 1: expected altitude, -100000 to 100000, got nan"),
    "off earth": (plan(simple(16, 0, 0, 0, 0, 91, 2, 3)), "item 1: expected latitude, -90 to 90, got 91"),
    "jump": (plan(THERE, simple(177, 7, 3, 0, 0, 0, 0, 0, frame=2)), "item 2 of the mission: it jumps to item 7"),
    "too many": (plan(*[THERE] * (MAX_ITEMS + 1)), "item 701: a mission has 700 items at most"),
    "version": (WPL.replace("110", "120"), "line 1: expected `QGC WPL 110`, got 'QGC WPL 120'"),
    "columns": (WPL.replace("\t20\t", "\t"), "line 6: expected 12 columns separated by tabs, got 11"),
    "numbering": (WPL.replace("\n2\t", "\n5\t"), "line 4: expected item 2, got 5"),
    "number": (WPL.replace("10.000000\t", "ten\t"), "line 3: expected a number, got 'ten'"),
    "home": (WPL.replace("0\t1\t0\t16", "0\t1\t0\t22"), "line 2: item 0 is home, expected command 16, got 22"),
    "home alone": ("\n".join(WPL.splitlines()[:2]), "it has no items"),
    "its jump": (WPL.replace("177\t2.0", "177\t9.0"), "item 3 of the mission: it jumps to item 9"),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_a_file_that_cannot_be_used_is_refused_by_its_place_and_what_was_expected(name: str) -> None:
    text, said = MISTAKES[name]
    with pytest.raises(BadPlan) as refused:
        parse_plan(text)
    assert said in str(refused.value)


def test_no_file_is_a_defect_whatever_it_holds() -> None:
    chance, texts = random.Random(7), [WPL, plan(TAKEOFF, survey(THERE), HOME)]
    values = ["null", "1e400", "-1", "{}", "[]", '"x"', "9" * 400, "NaN", "true", "16", "\t", "", "\x00", "\ud800"]
    for _ in range(some_of(20_000)):
        words = re.split(r"([\s,:\[\]{}]+)", chance.choice(texts))
        for _ in range(chance.randint(1, 3)):
            words[chance.randrange(len(words))] = chance.choice(values)
        with suppress(BadPlan):
            for item in parse_plan("".join(words)).items:
                assert write_plan((item, item), "plan")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("/etc/secret.plan", "relative to the mission file, without `..`"),
        ("../secret.plan", "relative to the mission file, without `..`"),
        ("a/../../secret.plan", "relative to the mission file, without `..`"),
        ("", "relative to the mission file"),
        ("survey.txt", "*.plan or *.waypoints"),
        ("link.plan", "leads out of the folder of the mission file by a link"),
        ("folder/secret.plan", "leads out of the folder of the mission file by a link"),
        ("round.plan", "cannot be followed to a file"),
        ("\ud800.plan", "cannot be followed to a file"),
    ],
)
def test_no_name_leads_out_of_the_folder_of_the_mission_file(tmp_path: Path, name: str, said: str) -> None:
    (tmp_path / "secret.plan").write_text(plan(THERE))
    folder = tmp_path / "mission"
    folder.mkdir()
    (folder / "link.plan").symlink_to(tmp_path / "secret.plan")
    (folder / "folder").symlink_to(tmp_path)
    (folder / "round.plan").symlink_to("round.plan")
    with pytest.raises(BadPlan) as refused:
        find_plan(folder, name)
    assert said in str(refused.value)


def test_a_missing_file_a_pipe_and_a_huge_file_are_refused_before_anything_waits_for_them(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.plan")
    with (tmp_path / "huge.plan").open("wb") as huge:
        huge.truncate(3 * 2**20)
    (tmp_path / "latin.plan").write_bytes(b'{"\xff')
    for name, said in (
        ("missing", "there is no such file on this machine"),
        ("pipe", "no regular file"),
        ("huge", "larger than 2097152 bytes"),
        ("latin", "expected UTF-8 text"),
    ):
        with pytest.raises(BadPlan, match=said):
            read_plan(find_plan(tmp_path, f"{name}.plan"))


def test_what_is_written_in_either_format_is_read_again_as_the_same_items(tmp_path: Path) -> None:
    home = Item(frame=0, x=-276040330, y=-485183630, z=21.0)
    items = (
        Item(dialect.MAV_CMD_NAV_TAKEOFF, 3, (0.0, 0.0, 0.0, math.nan), 0, 0, 10.0),
        Item(x=-276036830, y=-485180520, z=20.25),
        Item(dialect.MAV_CMD_DO_DIGICAM_CONTROL, 2, (1.0, 0.0, 0.0, 0.0), 1, 0, 0.0),
        Item(dialect.MAV_CMD_DO_JUMP, 2, (2.0, 3.0, 0.0, 0.0), autocontinue=0),
        Item(dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH, 0),
    )
    for kind in ("plan", "waypoints"):
        text = write_plan((home, *items), kind)  # type: ignore[arg-type]
        assert repr(parse_plan(text).items) == repr(items)
    (tmp_path / "m.waypoints").write_text(text.replace("NaN", "0"))
    assert mavwp.MAVWPLoader().load(str(tmp_path / "m.waypoints")) == 6
    written: dict[str, Any] = json.loads(write_plan((home, *items), "plan", autopilot=12, vehicle=1))
    assert written["mission"]["plannedHomePosition"] == [-27.604033, -48.518363, 21.0]
    assert (written["mission"]["firmwareType"], written["mission"]["vehicleType"]) == (12, 1)


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_an_agent_uploads_a_plan_with_its_fence_and_rally_points_and_is_told_what_is_not_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, autopilot: AutopilotName
) -> None:
    monkeypatch.chdir(tmp_path)  # the folder of the mission file
    sky = Sky(tmp_path, vehicle=Vehicle(START, KINDS["copter", autopilot]))
    (tmp_path / "plans").mkdir()
    text = plan(TAKEOFF, survey(THERE), HOME, geoFence=FENCE, rallyPoints=RALLY)
    (tmp_path / "plans" / "field.plan").write_text(text)
    status = sky.do("upload_plan", "plans/field.plan")
    assert (status.state, status.reason) == ("succeeded", "not taken from the file: the breach return point")
    assert [held(sky, kind) for kind in (1, 2)] == [5, 1]
    assert held(sky, 0) == 3 + (autopilot == "ardupilot"), "home is an item there"
    missing = sky.do("upload_plan", "plans/other.plan")
    assert (missing.state, missing.cause) == ("refused", "request")


def test_a_plan_whose_fence_is_elsewhere_is_stored_without_it_and_that_is_a_failure(
    sky: Sky, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    around_home = {"inclusion": False, "circle": {"center": [START.lat, START.lon], "radius": 10}}
    (tmp_path / "a.plan").write_text(plan(TAKEOFF, THERE, HOME, geoFence={"circles": [around_home]}))
    status = sky.do("upload_plan", "a.plan")
    assert (status.state, status.reason) == ("failed", "the mission is stored, but home is outside of the fence")
    assert held(sky, 1) == 0


def held(sky: Sky, kind: int) -> int:
    """How many items of a list (MAV_MISSION_TYPE) the vehicle holds."""
    (reply,) = sky.vehicle.receive(dialect.MAVLink_mission_request_list_message(1, 1, kind))
    return int(reply.count)


def test_a_plan_is_flown_to_its_end(sky: Sky, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    lines = [simple(16, 0, 0, 0, None, ON_LAND[0] + north, ON_LAND[1], 12) for north in (1e-4, 2e-4)]
    jump = simple(177, 2, 1, 0, 0, 0, 0, 0, frame=2, jump=9)
    (tmp_path / "survey.plan").write_text(plan(TAKEOFF, THERE, survey(*lines), jump, HOME))
    for name, *arguments in (("set_mode", "GUIDED"), ("upload_plan", "survey.plan"), ("arm_motors", True)):
        sky.done(str(name), *arguments)
    status = sky.do("start_mission", within=600)
    assert (status.state, status.feedback["reached"]) == ("succeeded", 6), status.reason
    reached = [one.parameters[0] for who, one in sky.percepts if (who, one.name) == ("uav", "item_reached")]
    assert reached == [1, 2, 3, 4, 2, 3, 4, 6], "it jumps back to THERE once"


def test_the_limits_of_the_mission_hold_for_items_of_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    sky = Sky(tmp_path, mission=LIMITED)
    sky.forward(lambda: sky.belief("home_pos"), "home")
    (tmp_path / "high.plan").write_text(plan(TAKEOFF, survey(THERE, THERE | {"params": [0, 0, 0, None, *NEAR, 31]})))
    (tmp_path / "far.waypoints").write_text(WPL.replace("-27.603683", "-27.613683"))
    for name in ("high.plan", "far.waypoints"):
        status = sky.do("upload_plan", name)
        assert (status.state, status.cause) == ("refused", "limits")
    assert sky.vehicle.autopilot.mission.items == []
