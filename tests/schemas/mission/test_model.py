"""Mission files: what is wrong is said in one line each, with file, line and column; nothing else ever comes out."""

import errno
import os
from pathlib import Path
from unittest.mock import Mock

import pytest

from schemas.files.findings import Findings
from schemas.files.shipped_files import shipped
from schemas.files.units import Duration
from schemas.mission.model import Mission, load_mission, read_mission

GOOD = """\
mission: single-uav
agents:
  uav:
    program: uav.asl
    robot: uav1
robots:
  uav1:
    manifest: copter
    link: udpin:127.0.0.1:14550
    simulate: {vehicle: copter, home: [-27.604033, -48.518363, 21.0]}
done: "uav: mission_done"
timeout: 15min
speed: 5
"""


def read(text: str) -> Mission:
    return read_mission(text, Path("m.yaml"))


def findings(text: str) -> list[str]:
    with pytest.raises(Findings) as caught:
        read(text)
    return str(caught.value).splitlines()


def test_a_mission_reads_with_its_defaults() -> None:
    mission = read(GOOD)
    assert (mission.name, mission.fleet, mission.speed, mission.timeout) == ("single-uav", "single-uav", 5.0, 900.0)
    assert mission.agents["uav"].board == "local"
    assert mission.robots["uav1"].on_agent_loss == ("hold 5s", "rtl")
    assert mission.robots["uav1"].failsafe.gcs is None
    assert [(done.agent, done.formula) for done in mission.done] == [("uav", "mission_done")]
    assert mission.agents_of("uav1") == ["uav"]
    assert mission.relative("uav.asl") == Path("uav.asl")


def test_a_client_may_have_a_robot_as_an_agent_has() -> None:
    text = GOOD + "clients: {pilot: {robot: uav1}, planner: {}}\n"
    assert read(text).agents_of("uav1") == ["uav", "pilot"]
    assert findings(text.replace("pilot: {robot: uav1}", "pilot: {robot: uav2}")) == [
        "m.yaml:14:26: error: there is no robot `uav2`, did you mean `uav1`?"
    ]


def test_the_shipped_mission_reads() -> None:
    path = shipped("missions", "single_uav.yaml")
    assert path is not None
    assert load_mission(path).name == "single-uav"


MISTAKES = Path(__file__).parents[2] / "data" / "mission_file_mistakes.txt"
"""Changes of `GOOD`, each with one mistake, and below each its findings."""


def test_each_mistake_is_told_as_written_down_where_it_stands() -> None:
    shown = []
    for block in MISTAKES.read_text(encoding="utf-8").split("\n\n"):
        change = [line for line in block.splitlines() if line.startswith(("- ", "+ "))]
        old, new = ("".join(f"{line[2:]}\n" for line in change if line.startswith(sign)) for sign in "-+")
        assert old in GOOD
        found = findings(GOOD.replace(old, new, 1))
        shown.append("".join(f"{line}\n" for line in (*change, *(f"    {one}" for one in found))))
    assert "\n".join(shown) == MISTAKES.read_text(encoding="utf-8")


def test_all_mistakes_are_told_in_one_run() -> None:
    text = GOOD.replace("robot: uav1", "robott: uav1").replace("15min", "soon").replace("speed: 5", "speed: -1")
    assert [line.split(": ", 1)[0] for line in findings(text)] == ["m.yaml:5:5", "m.yaml:12:10", "m.yaml:13:8"]


FLEET = GOOD.replace(
    "agents:\n  uav:", "boards: {a: {address: 10.0.0.1}, b: {address: 10.0.0.2}}\nagents:\n  uav:\n    board: a"
)
FLEET = FLEET.replace("  uav1:\n", "  uav1:\n    board: a\n")


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("boards: {a: {address: 10.0.0.1}, b: {address: '10.0.0.1:7447'}}", "`10.0.0.1:7447` is board `a` already"),
        ("boards: {a: {}, b: {address: '10.0.0.1:99999'}}", "Expected HOST or HOST:PORT such as `10.0.0.7:9000`"),
        ("clients: {planner: {}}", "clients.planner: needs `board:`, one of a, b"),
        ("gateway: {listen: 'h:1', nodes: {}}", "gateway: needs `board:`, one of a, b"),
        ("clients: {planner: {board: c}}", "clients.planner: there is no board `c`"),
        ("clients: {uav: {board: a}}", "`uav` is in agents already"),
        ("clients: {mail: {board: a}}", "`mail` is the sender of notices"),
        ("gateway: {board: c, listen: '127.0.0.1:9000', nodes: {}}", "gateway: there is no board `c`"),
        ("gateway: {board: a, listen: '9000', nodes: {}}", "gateway.listen: Expected HOST:PORT"),
        ("gateway: {board: a, listen: 'h:1', nodes: {old: h}}", "gateway.nodes.old: Expected HOST:PORT"),
        ("gateway: {board: a, listen: 'h:1', nodes: {df: 'h:2'}}", "`df` is the sender of notices"),
        ("radio: {range: far}", "radio.range: expected a distance such as `300m` or `1.5km`, got `far`"),
        ("clients: {planner: {board: true}}", "clients.planner.board: expected a text, got `true`"),
        ("radio: {loss: 1}", "radio.loss"),
        ("mail: {mailbox: 0}", "mail.mailbox"),
    ],
)
def test_a_mistake_about_a_fleet_is_told(line: str, expected: str) -> None:
    kept = [one for one in FLEET.splitlines() if one.partition(":")[0] != line.partition(":")[0]]
    assert any(expected in one for one in findings("\n".join([*kept, line])))


def test_a_fleet_reads() -> None:
    line = (
        "gateway: {board: b, listen: 'h:1', nodes: {old: 'h:2'}}\nclients: {planner: {board: b}}\nradio: {range: 1.5km}"
    )
    mission = read(FLEET + line)
    assert mission.mailboxes == {"uav": "a", "planner": "b", "old": "b"}
    assert mission.radio.range == 1500.0


def test_robots_share_a_link_if_they_are_different_systems() -> None:
    robot = "  uav2:\n    manifest: copter\n    link: udpin:127.0.0.1:14550\n"
    assert findings(GOOD.replace("done:", robot + "done:")) == [
        "m.yaml:13:11: error: system 1 on `udpin:127.0.0.1:14550` is robot `uav1` already: "
        "give each vehicle its own sysid"
    ]
    shared = read_mission(GOOD.replace("done:", robot + "    sysid: 2\ndone:"), Path("m.yaml"))
    assert [shared.robots[name].sysid for name in ("uav1", "uav2")] == [1, 2]


def test_a_mission_may_have_programs_alone() -> None:
    mission = read("mission: m\nagents: {}\nclients: {pilot: {robot: uav1}}\nrobots: {uav1: {manifest: copter}}\n")
    assert mission.agents_of("uav1") == ["pilot"]
    assert mission.mailboxes == {"pilot": "local"}


def test_a_mission_of_nobody_is_refused() -> None:
    with pytest.raises(Findings, match="a mission needs at least one agent, or a program in `clients`"):
        read("mission: m\nagents: {}\n")


@pytest.mark.parametrize("text", ["", "[]", "7", "- a", "mission: x", "agents: {}\nmission: x", "\x00", "&a [*a]"])
def test_what_is_no_mission_at_all_is_refused(text: str) -> None:
    assert findings(text)


def test_a_missing_or_unreadable_file_is_a_finding(tmp_path: Path) -> None:
    with pytest.raises(Findings, match=r"nowhere\.yaml: error: cannot be read: No such file or directory"):
        load_mission(tmp_path / "nowhere.yaml")
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(Findings, match="expected UTF-8 text"):
        load_mission(tmp_path / "binary.yaml")


def test_a_disk_or_machine_that_fails_while_a_file_is_read_makes_no_bad_input_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "m.yaml").write_text("mission: m")
    for number, failing in ((errno.EIO, "os.fdopen"), (errno.ENFILE, "os.open")):
        error = OSError(number, os.strerror(number), "m.yaml")
        monkeypatch.setattr(failing, Mock(side_effect=error))
        with pytest.raises(OSError, match=os.strerror(number)):
            load_mission(tmp_path / "m.yaml")
        monkeypatch.undo()


def test_a_file_that_nobody_wrote_is_refused_at_once(tmp_path: Path) -> None:
    (tmp_path / "big.yaml").write_bytes(b"# a comment\n" * 100_000)
    with pytest.raises(Findings, match=r"big\.yaml: error: larger than 150000 bytes"):
        load_mission(tmp_path / "big.yaml")


@pytest.mark.parametrize(
    ("text", "seconds"), [("5s", 5.0), ("500ms", 0.5), ("15min", 900.0), ("1h", 3600.0), (7, 7.0), ("1.5 s", 1.5)]
)
def test_durations_read_as_people_write_them(text: object, seconds: float) -> None:
    assert Duration.read(text) == seconds


@pytest.mark.parametrize("text", ["", "s", "-1s", "5 parsec", True, None, [], float("inf"), float("nan")])
def test_what_is_no_duration_is_refused(text: object) -> None:
    with pytest.raises(ValueError, match="Expected a duration such as"):
        Duration.read(text)


def test_a_bare_name_is_the_shipped_mission_or_a_file_of_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert load_mission("turtle").path == shipped("missions", "turtle.yaml")
    (tmp_path / "turtle").write_text((shipped("missions", "turtle.yaml") or tmp_path).read_text())
    assert load_mission("turtle").path == Path("turtle")
    with pytest.raises(
        Findings, match=r"tortoise: error: no such file, and no mission .* known are .*single_uav.*turtle"
    ):
        load_mission("tortoise")
    with pytest.raises(Findings, match="no mission of that name ships, did you mean `turtle`"):
        load_mission("turtel")
    with pytest.raises(Findings, match=r"uav\.asl: error: expected a mission in YAML; programs are for `agentd run`"):
        load_mission("uav.asl")
