"""`argosy check`: every finding in one run, each at its line."""

import json
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from argosy.__main__ import main
from argosy.check.command import check_mission
from tests.argosy.conftest import MISSIONS
from tests.bridged.plugins import install
from tests.support.amount import some_of

MISSION = """\
mission: survey
agents:
  scout:
    program: scout.asl
    robot: uav1
    beliefs: ["sector(2)"]
robots:
  uav1:
    manifest: copter
    link: udpin:127.0.0.1:14550
    simulate: {vehicle: copter, home: [-27.6, -48.5, 21.0]}
done: "scout: surveyed(S)"
"""
PROGRAM = """\
!survey.
+!survey : sector(S) & state(Mode, true, _) & not Mode == "LAND" <- takeoff(5); !rest(S).
+!rest(S) <- land; +surveyed(S).
"""


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    """Return a mission file that is right, with its program beside it."""
    (tmp_path / "scout.asl").write_text(PROGRAM)
    path = tmp_path / "survey.yaml"
    path.write_text(MISSION)
    return path


def edit(path: Path, old: str, new: str) -> None:
    """Change one place of a file."""
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def findings(mission: Path) -> list[str]:
    """Return the findings as lines, files without their folder."""
    return [str(one).replace(f"{mission.parent}/", "") for one in check_mission(mission)[1]]


def test_a_mission_that_is_right_is_ok(mission: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(mission)]) == 0
    said = capsys.readouterr()
    assert said.out == f"{mission}: ok: 1 agent, 1 robot, 1 done formula\n"
    assert said.err == ""


@pytest.mark.parametrize("shipped", sorted(MISSIONS.glob("*.yaml")), ids=lambda path: path.stem)
def test_the_shipped_missions_are_right(shipped: Path) -> None:
    assert check_mission(shipped, restarts=True)[1] == []


def test_one_program_alone_and_the_same_in_a_team_are_judged_alike(mission: Path) -> None:
    edit(mission.with_name("scout.asl"), "state(Mode, true, _)", "state(Mode, true, _, _)")  # as of another robot
    edit(mission.with_name("scout.asl"), "sector(S) &", "sector(S) & unheard_of(S) &")
    alone = findings(mission)
    assert len(alone) == 2
    more = '  second: {program: scout.asl, robot: uav1, beliefs: ["sector(3)"]}\n  third: {program: other.asl}\n'
    edit(mission, "robots:", f"{more}robots:")
    mission.with_name("other.asl").write_text("+!look : state(_, _, _, _) & unheard_of(_) <- .print(yes).\n")
    assert [line for line in findings(mission) if line.startswith("scout.asl")] == alone


def test_what_an_included_file_believes_counts_for_the_end_of_the_mission(mission: Path, tmp_path: Path) -> None:
    (tmp_path / "scout.asl").rename(tmp_path / "inner.asl")
    (tmp_path / "scout.asl").write_text('{ include("inner.asl") }\n')
    assert findings(mission) == []


@pytest.mark.parametrize("wrong", ["+!go <- .print(1.", "+!go <- .print(1"])
@pytest.mark.parametrize("first", [True, False])
def test_a_syntax_error_does_not_hide_a_missing_include(mission: Path, wrong: str, first: bool) -> None:
    lines = ['{ include("no.asl") }', "+!look <- .print(no).", wrong]
    mission.with_name("scout.asl").write_text("\n".join(lines if first else [wrong, *lines[:2]]) + "\n")
    found = findings(mission)
    line = 1 if first else 2
    assert any(one.startswith(f'scout.asl:{line}:1: error: cannot include "no.asl"') for one in found), found
    assert len(found) == 2, found


def test_all_files_are_checked_whatever_the_first_holds(mission: Path, capsys: pytest.CaptureFixture[str]) -> None:
    edit(mission, "mission: survey", "mission: survey\nspeeed: 5")
    edit(mission.with_name("scout.asl"), "land;", "lnd;")
    assert main(["check", str(mission)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert f"{mission}:2:1: error: speeed: there is no such field, did you mean `speed`?" in lines
    assert f"{mission.parent}/scout.asl:3:14: error: there is no action lnd/0, did you mean `land`?" in lines
    assert lines == sorted(lines, key=lambda line: line.split(":")[0])


def test_findings_come_as_json_too(mission: Path, capsys: pytest.CaptureFixture[str]) -> None:
    edit(mission, "done:", "dome:")
    assert main(["check", "--json", str(mission)]) == 2
    (found, *_) = json.loads(capsys.readouterr().out)
    assert found["file"] == str(mission)
    assert (found["line"], found["column"], found["severity"]) == (12, 1, "error")


def test_robots_that_share_a_link_pass_where_they_can_meet(mission: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot = MISSION.partition("robots:\n")[2].partition("done:")[0]
    edit(mission, "done:", f"{robot.replace('uav1', 'uav2')}    sysid: 2\ndone:")
    assert findings(mission) == []
    assert main(["check", str(mission)]) == 0
    edit(mission, "link: udpin", "link: udpout")
    assert main(["check", str(mission)]) == 0
    why = "it shares a udpout link, and simulated robots can share only a udpin or tcpin link"
    assert (
        f"{mission}:14:11: warning: {why}: this robot can only be flown with --real uav1,uav2\n"
        in capsys.readouterr().err
    )


def test_functions_without_a_twin_can_only_be_those_of_the_real_robot(
    mission: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    functions = {"sonar_functions": "__all__ = ['metres']\ndef metres():\n    return 1.0\n"}
    install(monkeypatch, mission.parent, functions, {"argosy.python": {"sonar": "sonar_functions"}})
    text = '[robot]\ndriver = "python"\n[percepts.depth]\nsource = "sonar.metres"\nargs = ["data"]\n'
    mission.with_name("sonar.toml").write_text(text)
    mission.with_name("scout.asl").write_text("+depth(D) <- +surveyed(D).\n")
    mission.write_text(
        "mission: m\nagents: {scout: {program: scout.asl, robot: s1}}\n"
        'robots:\n  s1: {manifest: sonar.toml, simulate: {}}\ndone: "scout: surveyed(S)"\n'
    )
    why = "the plug-in `sonar` has no simulated twin (entry point of `argosy.python.simulated`)"
    assert main(["check", str(mission)]) == 0
    told = f"{mission}:4:7: warning: {why}: this robot can only be flown with --real s1\n"
    assert capsys.readouterr().err == told
    assert main(["run", str(mission)]) == 2
    assert capsys.readouterr().err == f"error: s1: {why}; fly the real one with --real s1\n"


def test_each_of_several_files_gets_its_line(mission: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wrong, missing = tmp_path / "wrong.yaml", tmp_path / "none.yaml"
    wrong.write_text(MISSION.replace("done:", "dome:"))
    assert main(["check", str(mission), str(wrong), str(missing)]) == 2
    assert capsys.readouterr().out.splitlines() == [
        f"{mission}: ok: 1 agent, 1 robot, 1 done formula",
        f"{wrong}: 1 error",
        f"{missing}: 1 error",
    ]


def test_what_every_robot_offers_is_known_without_its_manifest(mission: Path) -> None:
    program = mission.with_name("scout.asl")
    more = """\
+holder(Agent) : bridge(up) & link(up) <- .print(Agent).
+feedback(goto, distance, D) : D < 10 <- .print(D).
+!leave : not override(_) <- release.
+!leave : override(M) <- .print(M); hand_over(other).
+?never <- !leave; hand_over.
"""
    program.write_text(PROGRAM + more)
    edit(mission, 'done: "scout: surveyed(S)"', 'done: ["scout: surveyed(S)", "scout: holder(scout)"]')
    assert findings(mission) == ["scout.asl:8:20: error: the action hand_over takes 1 argument, not 0"]


@settings(
    max_examples=some_of(150),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(st.data())
def test_whatever_the_files_hold_there_are_findings_and_no_traceback(mission: Path, data: st.DataObject) -> None:
    noise = st.text(st.sampled_from("abcXYZ_0123456789.,:;!?+-*/()[]{}<>&|~@#\"'\\ \n\t\x00é"), max_size=8)
    for path, text in ((mission, MISSION), (mission.with_name("scout.asl"), PROGRAM)):
        at, length = data.draw(st.integers(0, len(text))), data.draw(st.integers(0, 12))
        path.write_text(text[:at] + data.draw(noise) + text[at + length :])
    for finding in check_mission(mission)[1]:
        assert "\n" not in str(finding)


@pytest.mark.parametrize(
    ("simulate", "said"),
    [
        (
            "{vehicle: plane, home: [-27.6, -48.5, 21.0]}",
            "m.yaml:4:72: error: simulate.vehicle: expected `rover`, the vehicle of its manifest, got `plane`",
        ),
        (
            "{home: [-27.6, -48.5, 21.0]}",
            "m.yaml:4:62: error: simulate: a rover on MAVLink needs a simulator: `{vehicle: rover, home: [...]}`",
        ),
    ],
)
def test_another_simulated_vehicle_than_that_of_the_manifest_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], simulate: str, said: str
) -> None:
    (tmp_path / "uav.asl").write_text("!g.\n+!g <- +done.\n")
    robot = f"{{manifest: rover, link: udpin:127.0.0.1:1, simulate: {simulate}}}"
    (tmp_path / "m.yaml").write_text(
        f'mission: m\nagents: {{uav: {{program: uav.asl, robot: uav1}}}}\nrobots:\n  uav1: {robot}\ndone: "uav: done"\n'
    )
    assert main(["check", str(tmp_path / "m.yaml")]) == 2
    assert said in capsys.readouterr().err


def test_an_action_the_simulator_does_not_have_is_a_warning(mission: Path, capsys: pytest.CaptureFixture[str]) -> None:
    edit(mission.with_name("scout.asl"), "land;", "orbit(-27.6, -48.5, 20, 30, 4);")
    edit(mission, "{vehicle: copter,", "{vehicle: copter, autopilot: ardupilot,")
    assert main(["check", str(mission)]) == 0
    said = "warning: the action orbit: ardupilot has no command by which a copter flies a circle"
    assert f"scout.asl:3:14: {said}" in capsys.readouterr().err


def test_a_belief_that_nothing_adds_is_reported_once_for_all_robots_of_a_program(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "pair.yaml"
    path.write_text(
        'mission: pair\nagents: {a: {program: a.asl, robot: r}, b: {program: a.asl, robot: s}}\ndone: "a: x"\n'
        "robots:\n  r: {manifest: copter, simulate: {vehicle: copter, home: [0, 0, 0]}}\n"
        "  s: {manifest: plane, simulate: {vehicle: plane, home: [0, 0, 0]}}\n"
    )
    (tmp_path / "a.asl").write_text("!go.\n+!go : landing(_) <- +x.\n+!go <- +x.\n")
    assert main(["check", str(path)]) == 0
    assert capsys.readouterr().err.count("nothing adds the belief landing/1") == 1


@pytest.mark.parametrize(
    ("correct", "wrong", "expected"),
    [
        ("home: [-27.6, -48.5, 21.0]", "home: [-27.6, -48.5]", "home: expected [latitude -90 to 90, longitude"),
        ("home: [-27.6, -48.5, 21.0]", "home: [-27.6, -48.5, .nan]", "home.2: expected a finite number, got `nan`"),
        ("simulate", "limits: {altitude: .inf}\n    simulate", "altitude: expected a finite number, got `inf`"),
        ("udpin:127.0.0.1:14550", "14550", "link: expected a link such as udpin:HOST:PORT, udpout:HOST:PORT, "),
    ],
)
def test_a_value_that_cannot_be_is_an_error_that_says_what_was_expected(
    mission: Path, capsys: pytest.CaptureFixture[str], correct: str, wrong: str, expected: str
) -> None:
    edit(mission, correct, wrong)
    assert main(["check", str(mission)]) == 2
    assert expected in capsys.readouterr().err
