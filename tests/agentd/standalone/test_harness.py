"""A harness for unit tests written in AgentSpeak, in the style of Jason's own, run as a program like any other.

``tests/data/harness``: a manager lists the files of cases, creates an agent of each and counts the results that they
mail. Each case includes the tester, which finds its plans with the annotation `test` and runs them one by one; the
assertion plans find file and line of the plan that makes them in its label.
"""

import re
from pathlib import Path

import pytest

from agentd.runtime.program_paths import SourcePaths
from agentd.standalone.standalone_team import Team, VirtualClock
from tests.agentd.teams import Stage

HARNESS = Path(__file__).parents[2] / "data" / "harness"
CASES = HARNESS / "cases"


@pytest.fixture
def lines(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    monkeypatch.chdir(HARNESS)
    return []


def _run(lines: list[str]) -> int:
    paths = SourcePaths()
    team = Team([("manager", paths.compiled("suite/manager.asl"))], out=lines.append, paths=paths, clock=VirtualClock())
    return team.run(timeout=100.0, exit_when_idle=True)


def _line_of(plan: str) -> int:
    """The line in which the plan of a name, or its label, stands in the failing case."""
    text = (CASES / "failing_case.asl").read_text(encoding="utf-8")
    return next(number for number, line in enumerate(text.splitlines(), 1) if re.match(rf"@{plan}\b|\+!{plan}\b", line))


def test_each_failed_assertion_is_reported_with_the_line_of_its_plan_and_each_failed_plan_with_that_of_its_formula(
    lines: list[str],
) -> None:
    assert _run(lines) == 1
    failed = "[manager] failing_case: {} failed at cases/failing_case.asl:{}: {}\n"
    broken = "[manager] failing_case: {} broken at cases/failing_case.asl:{}: {}\n"
    assert [line for line in lines if line.startswith("[manager] failing_case")] == [
        failed.format("differs", _line_of("differs"), "expected 4, got 3"),
        failed.format("differs", _line_of("differs"), "expected [a,b], got [a]"),
        failed.format("deep_check", _line_of("deep_check"), "expected (7 < 3)"),
        failed.format("deep_check", _line_of("deep_check"), "expected c in [a]"),
        failed.format("deep_check", _line_of("deep_check"), "expected 1 <= 5 <= 4"),
        failed.format("forced_to_fail", _line_of("forced_to_fail"), "not yet"),
        broken.format(
            "asks_in_vain", _line_of("asks_in_vain") + 1, "test_goal_failed: Failed to test 'nothing(7)' in nothing(7)"
        ),
        broken.format("fails_below", _line_of("deeper"), "constraint_failed:  in (2 > 3)"),
        broken.format(
            "has_no_plan",
            _line_of("has_no_plan"),
            "no_relevant: Found a goal for which there is no relevant plan: +!never_written(1)[source(self)] "
            "in never_written(1)[source(self)]",
        ),
    ]


def test_cases_that_pass_are_counted_and_say_nothing(lines: list[str]) -> None:
    _run(lines)
    assert [line for line in lines if "failing_case" not in line] == [
        "[manager] looking for cases\n",
        "[bodies_case] at .intention(_,_,[im(Label,{ +!Goal },{ Formula; _ },_)|_],current)\n",
        "[bodies_case] nobody knows unheard_of (no_relevant)\n",
        "[manager] 21 passed, 6 failed, 3 broken\n",
    ]


def test_a_suite_in_which_a_case_says_nothing_ends_by_its_own_time_limit(
    lines: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cases").mkdir()
    (tmp_path / "cases" / "silent_case.asl").write_text("!s. +!s <- .wait({+never}).\n")
    (tmp_path / "suite").symlink_to(HARNESS / "suite")
    monkeypatch.chdir(tmp_path)
    assert _run(lines) == 3
    assert lines[-1] == "[manager] no word from [silent_case]\n"


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
    where, url = ',code_src("bob.asl"),source(self)', 'url("file:bob.asl")'
    assert stage.lines == [
        f"[bob] middle_plan[code_line(4){where},tag,{url}] {{ +!middle(5)[source(self)] }} !asked(5)",
        f"[bob] outer_plan[code_line(3){where},{url}] {{ +!outer[source(self)] }} !middle(5) .print(never)",
        "[bob] []",
        '[bob] 1 running [map("N",5)]',
        f"[bob] asked_plan[code_line(5){where},{url}] .intention(1,_,[im(L3,_,{{ F3; _ }},_)|_],current)",
    ]
