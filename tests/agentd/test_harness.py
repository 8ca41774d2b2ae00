"""A suite of test programs that manages itself in AgentSpeak, written in the idioms of Jason's own.

``tests/data/harness``: a judge lists the files of cases, creates an agent of each and counts what they tell it; each
includes a file by ``$suite/...`` that finds its plans with the annotation ``test`` and runs them one by one.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from agentd.clocks import VirtualClock
from agentd.paths import read_folders
from agentd.standalone import Team
from tests.agentd.teams import Stage

HARNESS = Path(__file__).parents[1] / "data" / "harness"


@pytest.fixture
def lines(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    monkeypatch.chdir(HARNESS)
    return []


def _run(judge: str, lines: list[str]) -> int:
    paths = read_folders(["$suite=suite"])
    team = Team([("judge", paths.compiled(judge))], out=lines.append, paths=paths, clock=VirtualClock())
    return team.run(timeout=100.0, exit_when_idle=True)


def test_each_case_is_run_and_each_failure_told_with_its_plan_file_line_formula_and_reason(lines: list[str]) -> None:
    assert _run("suite/judge.asl", lines) == 1
    assert [line for line in lines if not line.startswith("[judge]")] == [
        "[bodies_case] nobody knows unheard_of (no_relevant)\n"
    ]
    assert [line for line in lines if line.startswith("[judge]")] == [
        "[judge] looking for cases\n",
        "[judge] failing_case: differs failed at suite/inc/checks.asl:11: "
        'internal_action: values differ in .fail(error_msg("values differ"),values(3,4))\n',
        "[judge] failing_case: asks_in_vain failed at cases/failing_case.asl:9: "
        "test_goal_failed: Failed to test 'nothing(7)' in nothing(7)\n",
        "[judge] failing_case: fails_below failed at cases/failing_case.asl:12: constraint_failed:  in (2 > 3)\n",
        "[judge] failing_case: has_no_plan failed at cases/failing_case.asl:14: no_relevant: "
        "Found a goal for which there is no relevant plan: +!never_written(1)[source(self)] "
        "in never_written(1)[source(self)]\n",
        "[judge] failing_case: acts_without_a_world failed at cases/failing_case.asl:16: "
        "action_failed: there is no environment that could perform fly in fly(3)\n",
        "[judge] 9 passed, 5 failed\n",
    ]


def test_a_suite_in_which_a_case_says_nothing_ends_by_its_own_time_limit(
    lines: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cases").mkdir()
    (tmp_path / "cases" / "silent_case.asl").write_text("!s. +!s <- .wait({+never}).\n")
    (tmp_path / "suite").symlink_to(HARNESS / "suite")
    monkeypatch.chdir(tmp_path)
    assert _run("suite/judge.asl", lines) == 3
    assert lines[-1] == "[judge] no word from [silent_case]\n"


INTENTION = """
!outer.
@outer_plan +!outer <- X = 5; !middle(X); .print(never).
@middle_plan[tag] +!middle(N) <- if (N > 3) { !asked(N) } else { !asked(0) }; true.
@asked_plan +!asked(N)
    :  .intention(Id, State, [im(L1, T1, { F1; R1 }, B1), im(L2, T2, { F2; R2 }, _)|Others], current)
  <- .print(L1, " ", T1, " ", F1); .print(L2, " ", T2, " ", F2, " ", R2); .print(Others);
     .print(Id, " ", State, " ", B1);
     .intention(Id, _, [im(L3, _, { F3; _ }, _)|_], current); .print(L3, " ", F3);
     .stopMAS.
"""


def test_a_context_sees_the_intention_it_is_evaluated_for_each_body_from_the_formula_that_it_is_at() -> None:
    stage = Stage({"bob": INTENTION})
    stage.run()
    assert stage.lines == [
        "[bob] middle_plan[tag] { +!middle(5)[source(self)] } { !asked(5) }",
        "[bob] outer_plan { +!outer[source(self)] } { !middle(5) } { .print(never) }",
        "[bob] []",
        '[bob] 1 running [map("N",5)]',
        "[bob] asked_plan { .intention(1,_,[im(L3,_,{ F3; _ },_)|_],current) }",
    ]
