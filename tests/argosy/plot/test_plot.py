"""`argosy plot`: figures and tables of recordings, made by the recorder's own writer."""

import csv
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from argosy.__main__ import main
from argosy.plot.command import read_scene
from argosy.recording.metadata import End, Facts
from argosy.recording.reader import Recording
from argosy.recording.write_queue import Heard
from argosy.recording.writer import RecordingWriter
from schemas.wire import keys
from schemas.wire.codec import codec
from schemas.wire.mind_records import ActivityEvent, MindActivity
from schemas.wire.records import ActionStatus, Header, Perception, Record, State
from schemas.wire.terms import Term
from tests.argosy.recording.test_disks import files_no_larger_than

BRIDGE = Header(source="bridge")
FLEET, SPEED, BEGUN = "sar", 5.0, 1_790_000_000_000_000_000
HOME, VICTIM = (-27.604033, -48.518363), (-27.6036, -48.5180)
MISSION = """\
mission: rescue
fleet: sar
agents:
  scout: {program: scout.asl, robot: uav1}
  rescuer: {program: rescuer.asl, robot: uav2}
  book: {program: book.asl}
robots:
  uav1: {manifest: copter, link: "udpin:127.0.0.1:14551"}
  uav2: {manifest: copter, link: "udpin:127.0.0.1:14552"}
"""


class Fleet:
    """Writes a recording; times are mission seconds, which pass five times as fast as the wall's."""

    def __init__(self, path: Path, fleet: str = FLEET, mission: str = MISSION) -> None:
        self.path, self.at, self.fleet = path, 0.0, fleet
        facts = Facts("one", "*", BEGUN, "1", "rescue", "rescue.yaml", mission, speed=SPEED)
        self._writer = RecordingWriter(path, facts)

    def put(self, key: str, record: Record) -> None:
        self.write(key, codec(type(record)).encode(record), codec(type(record)).encodings["json"])

    def write(self, key: str, payload: bytes, encoding: str) -> None:
        """Record bytes that are put on a key now."""
        self._writer.add(Heard(BEGUN + round(self.at / SPEED * 1e9), key, payload, encoding))

    def percept(self, agent: str, name: str, *parameters: Term) -> None:
        self.put(keys.percept(self.fleet, agent, name), Perception(header=BRIDGE, name=name, parameters=parameters))

    def action(self, agent: str, number: int, state: State, name: str, *parameters: Term, reason: str = "") -> None:
        status = ActionStatus(id=f"{agent}:1:{number}", state=state, name=name, parameters=parameters, reason=reason)
        self.put(keys.status(self.fleet, agent, name), status)

    def activity(self, agent: str, ago: float, **fields: object) -> None:
        """Record what an agent did so many seconds ago; each agent's own clock begins at another time."""
        now = self.at + {"scout": 3.0, "rescuer": 50.0}.get(agent, 0.0)
        events = (ActivityEvent(time=now - ago, **fields),)  # type: ignore[arg-type]
        header = Header(source=agent, boot="1")
        record = MindActivity(header=header, agent=agent, now=now, speed=SPEED, events=events)
        self.put(keys.trace(self.fleet, agent, "activity"), record)

    def close(self) -> Path:
        self._writer.close(End("done", BEGUN + round(self.at / SPEED * 1e9)))
        return self.path

    def cut_off(self) -> Path:
        """End it as a recorder does that is killed."""
        self._writer.flush()
        self._writer.abandon()
        return self.path


def fly(fleet: Fleet) -> None:
    """The scout sees a victim; the rescuer fails to take off, flies there, drops its buoy and comes home."""
    for agent in ("scout", "rescuer"):
        fleet.percept(agent, "home_pos", *HOME)
        fleet.percept(agent, "state", "GUIDED", True, True)
        fleet.percept(agent, "battery", 0, 12.5, 99)
    fleet.action("rescuer", 1, "accepted", "takeoff", 10)
    fleet.at = 2.0
    fleet.action("rescuer", 1, "failed", "takeoff", 10, reason="no position")
    fleet.percept("scout", "victim", 7, *VICTIM)
    fleet.activity("scout", 0.1, kind="sent", id="m1", other="rescuer", performative="tell", text="victim(7)")
    fleet.at = 3.0
    fleet.activity("rescuer", 0.5, kind="received", id="m1", other="scout", performative="tell", text="victim(7)")
    fleet.activity("rescuer", 0.1, kind="sent", id="m2", other="scout", performative="askOne", text="claim(7,$x$)")
    fleet.action("rescuer", 2, "running", "goto", *VICTIM, 10)
    for second in range(4, 21):
        fleet.at = float(second)
        share = min(1.0, (second - 4) / 10)
        fleet.percept("rescuer", "global_pos", *(a + (b - a) * share for a, b in zip(HOME, VICTIM, strict=True)))
        fleet.percept("rescuer", "altitude", 10 * share)
        fleet.percept("scout", "global_pos", *HOME)
    fleet.action("rescuer", 2, "succeeded", "goto", *VICTIM, 10)
    fleet.action("rescuer", 3, "succeeded", "drop_buoy")
    fleet.percept("rescuer", "state", "RTL", True, True)
    fleet.action("rescuer", 4, "running", "return_to_launch")
    fleet.at = 30.0
    fleet.percept("rescuer", "state", "RTL", True, False)


@pytest.fixture
def flown(tmp_path: Path) -> Path:
    fleet = Fleet(tmp_path / "flown.mcap")
    fly(fleet)
    return fleet.close()


def words(svg: Path) -> list[str]:
    """Return the texts of a figure: matplotlib draws them and writes them beside as comments."""
    text = svg.read_text(encoding="utf-8")
    ElementTree.fromstring(text)
    return re.findall(r"<!-- (.*?) -->", text)


def test_a_figure_has_track_altitude_modes_actions_messages(flown: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plot", str(flown)]) == 0
    out = flown.with_suffix(".svg")
    assert capsys.readouterr().out == f"{out}: 2 robots, 4 actions, 2 messages, 0.0 s to 30.0 s, 7.13 in wide\n"
    seen = words(out)
    for wanted in ("m east of home", "m north of home", "m above home", "s of mission", "uav1", "uav2", "home", "7"):
        assert wanted in seen
    for wanted in ("target", "victim", "drop_buoy", "GUIDED", "RTL", "goto", "failed", "no outcome recorded", "ask"):
        assert wanted in seen


def test_the_same_recording_gives_the_same_bytes(flown: Path, tmp_path: Path) -> None:
    for suffix in ("svg", "pdf", "png"):
        one, two = (tmp_path / f"{name}.{suffix}" for name in ("one", "two"))
        assert main(["plot", str(flown), "-o", str(one)]) == main(["plot", str(flown), "-o", str(two)]) == 0
        assert one.read_bytes() == two.read_bytes()


def test_a_figure_or_table_that_has_no_room_leaves_the_one_before_and_names_its_file(
    flown: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, table = tmp_path / "flight.svg", tmp_path / "tracks.csv"
    out.write_text("before")
    table.write_text("before")
    with files_no_larger_than(1000):
        assert main(["plot", str(flown), "-o", str(out)]) == 1
        assert main(["plot", str(flown), "--csv", str(tmp_path)]) == 1
    assert (out.read_text(), table.read_text(), list(tmp_path.glob(".*"))) == ("before", "before", [])
    assert capsys.readouterr().err.splitlines()[-2:] == [
        f"error: {out}: File too large",
        f"error: {table}: File too large",
    ]


def test_a_figure_is_as_wide_as_a_column_of_paper(flown: Path, tmp_path: Path) -> None:
    out = tmp_path / "narrow.svg"
    assert main(["plot", str(flown), "-o", str(out), "--width", "one"]) == 0
    width = ElementTree.parse(out).getroot().get("width", "")
    assert float(width.removesuffix("pt")) / 72 * 25.4 == pytest.approx(88.0, abs=0.1)


def test_messages_stand_at_the_time_at_which_they_were_sent_although_each_agent_counts_its_own(flown: Path) -> None:
    told, asked = read_scene(Recording(flown)).messages
    assert (told.sender, told.receiver, told.performative) == ("scout", "rescuer", "tell")
    assert told.sent == pytest.approx(1.9, abs=1e-6)
    assert told.received == pytest.approx(2.5, abs=1e-6)
    assert (asked.sent, asked.received) == (pytest.approx(2.9, abs=1e-6), None)


def test_places_are_what_robots_saw_flew_to_and_left_behind_and_no_other_figures(flown: Path) -> None:
    places = read_scene(Recording(flown)).places
    assert [(place.kind, place.robot, place.label) for place in places] == [
        ("victim", "uav1", "7"),
        ("target", "uav2", ""),
        ("drop_buoy", "uav2", ""),
    ]
    assert {place.position for place in places} == {VICTIM}


def test_a_part_shows_one_robot_and_its_time_alone(flown: Path, tmp_path: Path) -> None:
    out = tmp_path / "part.svg"
    assert main(["plot", str(flown), "-o", str(out), "--robot", "uav2", "--from", "3", "--to", "20.5"]) == 0
    seen = words(out)
    assert "uav1" not in seen
    assert "takeoff" not in seen
    assert "goto" in seen


def test_chosen_panels_alone_are_drawn(flown: Path, tmp_path: Path) -> None:
    out = tmp_path / "part.svg"
    assert main(["plot", str(flown), "-o", str(out), "--panels", "modes,altitude"]) == 0
    seen = words(out)
    assert {"m above home", "RTL"} <= set(seen)
    assert not {"m east of home", "goto", "scout"} & set(seen)


def test_tables_hold_what_the_figure_shows(flown: Path, tmp_path: Path) -> None:
    folder = tmp_path / "tables"
    assert main(["plot", str(flown), "--csv", str(folder)]) == 0
    tables = {path.stem: list(csv.DictReader(path.open(encoding="utf-8"))) for path in folder.iterdir()}
    assert set(tables) == {"tracks", "altitudes", "modes", "actions", "messages", "places"}
    failed = tables["actions"][0]
    assert (failed["action"], failed["state"], failed["reason"], failed["end_s"]) == (
        "takeoff(10)", "failed", "no position", "2.000",
    )  # fmt: skip
    assert tables["actions"][-1]["end_s"] == ""  # nobody heard of its end
    last = tables["tracks"][-2]
    assert float(last["m_north"]) == pytest.approx(48.2, abs=0.1)


def test_without_the_mission_each_agent_that_perceives_is_a_robot_of_its_own(tmp_path: Path) -> None:
    fleet = Fleet(tmp_path / "bare.mcap", mission="")
    fly(fleet)
    scene = read_scene(Recording(fleet.close()))
    assert list(scene.robots) == ["rescuer", "scout"]


def test_a_recording_cut_off_is_plotted_as_far_as_it_goes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fleet = Fleet(tmp_path / "cut.mcap")
    fly(fleet)
    assert main(["plot", str(fleet.cut_off())]) == 0
    assert "warning: " in capsys.readouterr().err
    assert "goto" in words(tmp_path / "cut.svg")


def empty(path: Path) -> Path:
    """A recording of agents without robots that did nothing."""
    fleet = Fleet(path)
    fleet.activity("book", 0.0, kind="print", text="hello")
    return fleet.close()


def two_fleets(path: Path) -> Path:
    """A recording of two fleets."""
    fleet = Fleet(path)
    fly(fleet)
    fleet.fleet = "other"
    fly(fleet)
    return fleet.close()


@pytest.fixture
def recordings(flown: Path, tmp_path: Path) -> None:
    empty(tmp_path / "empty.mcap")
    two_fleets(tmp_path / "two.mcap")
    (tmp_path / "text.mcap").write_text("no recording\n", encoding="utf-8")


@pytest.mark.usefixtures("recordings")
@pytest.mark.parametrize(
    ("arguments", "code", "told"),
    [
        ("flown.mcap --robot uav9", 2, "flown.mcap: --robot uav9: there is no such robot in it; there are uav1, uav2"),
        ("flown.mcap --from 900", 2, "nothing lies between 900 s and 30 s: it goes from 0.0 s to 30.0 s"),
        ("flown.mcap --from 9 --to 3", 2, "nothing lies between 9 s and 3 s"),
        ("none.mcap -o a.jpg", 2, "error: --out a.jpg: expected a name that ends in .svg, .png, .pdf"),
        ("flown.mcap -o nowhere/a.svg", 1, "nowhere/a.svg: No such file or directory"),
        ("flown.mcap --fleet sea", 2, "there is no fleet sea in it; there are sar"),
        ("empty.mcap", 1, "it has no positions: no percept global_pos(Latitude, Longitude); 2 robots, 0 actions"),
        ("empty.mcap --panels actions", 1, "it has no actions; 2 robots, 0 actions, 0 messages"),
        ("empty.mcap --csv tables", 1, "it has no positions"),
        ("two.mcap", 2, "it has several fleets, choose one with --fleet: other, sar"),
        ("text.mcap", 2, "text.mcap: not an MCAP file"),
        ("none.mcap", 2, "none.mcap: No such file or directory"),
    ],
)
def test_what_cannot_be_plotted_is_told_in_one_line(
    arguments: str,
    code: int,
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["plot", *arguments.split()]) == code
    said = capsys.readouterr()
    assert said.out == ""
    assert told in said.err
    assert said.err.count("\n") == 1
    assert said.err.startswith("error: ")
    assert not (tmp_path / "a.svg").exists()


def test_panels_and_widths_that_there_are_none_of_are_refused(flown: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in (["--panels", "speed"], ["--width", "three"], ["--width", "20"]):
        with pytest.raises(SystemExit, match="2"):
            main(["plot", str(flown), *arguments])
    assert "track, altitude, modes, actions, messages" in capsys.readouterr().err


def test_records_that_this_version_cannot_read_are_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fleet = Fleet(tmp_path / "later.mcap")
    fly(fleet)
    fleet.write(keys.percept(FLEET, "scout", "later"), b'{"name": 7}', codec(Perception).encodings["json"])
    assert main(["plot", str(fleet.close())]) == 0
    assert capsys.readouterr().err == (
        "note: 1 of its records Perception cannot be read: another version of Argosy wrote them\n"
    )


def test_figures_that_are_no_place_and_no_time_end_in_a_line_or_are_not_drawn(
    flown: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for number in ("nan", "inf"):
        with pytest.raises(SystemExit) as ended:
            main(["plot", str(flown), "--from", number])
        assert ended.value.code == 2
        assert f"argument --from: expected a number of seconds, got `{number}`" in capsys.readouterr().err
    fleet = Fleet(tmp_path / "wild.mcap")
    fly(fleet)
    for big in (1e308, -1e308, 200.0, float("inf")):
        fleet.percept("rescuer", "global_pos", big, big)
        fleet.percept("scout", "home_pos", big, 5)
        fleet.percept("scout", "victim", 9, big, big)
        fleet.percept("rescuer", "altitude", big)
        fleet.action("rescuer", 9, "running", "goto", big, big, 10)
    path = fleet.close()
    assert main(["plot", str(path)]) == 0
    told = capsys.readouterr()
    assert "Limits" not in told.err
    assert "Warning" not in told.err
    assert [place.kind for place in read_scene(Recording(path)).places] == ["victim", "target", "drop_buoy"]
