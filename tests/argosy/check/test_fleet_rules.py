"""What `argosy check` says of a team: receivers, presence, restarts, boards, the radio."""

from pathlib import Path

import pytest

from argosy.__main__ import main
from argosy.check.command import check_mission

MISSION = """\
mission: pair
boards: {pi1: {address: 10.0.0.11}, pi2: {address: 10.0.0.12}}
agents:
  one: {program: one.asl, board: pi1, presence: true, on_restart: goal(recover)}
  two: {program: two.asl, board: pi2}
clients: {planner: {board: pi1}}
gateway: {board: pi1, listen: "10.0.0.11:9000", nodes: {old: "10.0.0.9:9000"}}
robots:
  uav1:
    board: pi1
    manifest: copter
    link: udpin:0.0.0.0:14550
    simulate: {board: sim, home: [-27.6, -48.5, 21.0]}
done: "one: enough"
"""
ONE = """\
!begin.
+!begin <- .send([two, planner, old], tell, hello); +enough.
+!recover <- .print("again").
+online(Agent)[board(Board)] <- .print(Agent, " ", Board).
+undelivered(Receiver, Performative, Content, Reason) <- .print(Receiver, Performative, Content, Reason).
+interrupted(Action, State, Reason) <- .print(Action, State, Reason).
"""
TWO = "+hello[source(Agent)] <- .print(Agent).\n"


@pytest.fixture
def pair(tmp_path: Path) -> Path:
    """Return a mission of two agents on two boards, and a machine that simulates, in which all is right."""
    (tmp_path / "one.asl").write_text(ONE)
    (tmp_path / "two.asl").write_text(TWO)
    path = tmp_path / "pair.yaml"
    path.write_text(MISSION)
    return path


def said(path: Path, capsys: pytest.CaptureFixture[str]) -> list[str]:
    """Return what the check complains about, files without their folder."""
    main(["check", str(path)])
    return capsys.readouterr().err.replace(f"{path.parent}/", "").splitlines()


def test_mail_its_receiver_refuses_is_told_where_it_is_sent(pair: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pair.write_text(f"{MISSION}security: {{operators: [ops]}}\n")
    begin = """\
+!begin <- +enough;
    .send(two, tellHow, {+!hunt <- .send(planner, achieve, this); .send(one, tellHow, "+!a.")});
    .send([planner, two], achieve, hello);
    .send(two, askHow, "+!hello", _, 1000);
    for (.member(How, [tell, tellHow])) { .send(two, How, hello) }.
"""
    (pair.parent / "one.asl").write_text(ONE.replace(ONE.splitlines(keepends=True)[1], begin))
    (pair.parent / "two.asl").write_text("+hello <- true. +!hello <- true.\n")

    def refused(line: str, performative: str) -> str:
        what = f"`two` does not accept `{performative}` from `one`"
        return f"{line}: warning: .send: {what}; `accepts` of agent `two` in the mission can allow it"

    assert said(pair, capsys) == [refused("one.asl:3:5", "tellHow"), refused("one.asl:5:5", "askHow")]
    pair.write_text(pair.read_text().replace("board: pi2}", "board: pi2, accepts: {one: [tellHow, askHow]}}"))
    assert said(pair, capsys) == [refused("one.asl:4:5", "achieve")]


def test_a_team_in_which_all_is_right_is_ok(pair: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert said(pair, capsys) == []


def test_programs_that_boards_could_not_be_given_are_told_before_units_are_written(
    pair: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    inner = pair.parent / "field" / "pair.yaml"
    inner.parent.mkdir()
    pair.with_name("one.asl").rename(inner.with_name("one.asl"))
    inner.write_text(MISSION.replace("two.asl", "../two.asl"))
    pair.with_name("beside.asl").write_text("")
    (told,) = said(inner, capsys)
    assert told.startswith("pair.yaml:5:18: warning: ")
    assert "two.asl is not below the mission file, whose folder is what a board gets" in told
    inner.write_text(MISSION.replace("two.asl", "../two.asl").replace("{address: 10.0.0.12}", "{}"))
    assert not [line for line in said(inner, capsys) if "not below" in line], "nothing is copied to it"


def test_a_real_robot_is_not_flown_with_a_model_of_the_radio(pair: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pair.write_text(f"{MISSION}radio: {{range: 300m}}\n")
    assert main(["run", str(pair), "--real", "uav1", "--yes"]) == 2
    assert "uav1 is real, and `radio` is a model of the air between simulated robots" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("program", "agent", "mission", "told"),
    [
        ("!fly. +!fly <- .wait(1000); +done. +battery(B) <- .print(B).", "", "restart: on-failure\n", True),
        ("!fly. +!fly <- .wait(1000); +done.", "", "", False),
        ("!fly. +!fly <- .wait(1000); +done.", ", on_restart: goal(fly)", "restart: on-failure\n", False),
        ("!fly. +!fly <- +done. +restarted(_) <- !fly.", "", "restart: on-failure\n", False),
    ],
)
def test_a_program_with_a_robot_says_what_it_does_when_it_is_started_again(
    tmp_path: Path, program: str, agent: str, mission: str, told: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "uav.asl").write_text(program)
    path = tmp_path / "m.yaml"
    path.write_text(
        f"{mission}mission: m\nagents:\n  uav: {{program: uav.asl, robot: uav1{agent}}}\ndone: 'uav: done'\nrobots:\n"
        "  uav1: {manifest: copter, link: udpin:127.0.0.1:14550, simulate: {home: [-27.6, -48.5, 21.0]}}\n"
    )
    text = (
        "agents.uav: the program has no plan for `+restarted(N)`, and the agent no `on_restart`: "
        "started again in the middle it leaves uav1 to its bridge"
    )
    assert (f"m.yaml:4:3: warning: {text}" in said(path, capsys)) is told
    _, found = check_mission(path, restarts=True)
    assert any(one.message == text for one in found) is (told or not mission), "`argosy run --restart` says so too"
