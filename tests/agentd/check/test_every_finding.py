"""One program holds every finding that `agentd check` knows; its comments say which line has which."""

import re
from pathlib import Path

import pytest

from agentd.check.finding_kinds import Kind
from tests.agentd.check.conftest import Check

ROOT = Path(__file__).parents[3]
FOLDER = ROOT / "tests" / "data" / "check"
PROGRAM = "tests/data/check/every_finding.asl"
OF_MISSIONS = {"unavailable-action"}
"""What only `argosy check` of a mission can find (tests/argosy/check)."""
KINDS = {kind.label for kind in Kind} - OF_MISSIONS
ONLY_ELSEWHERE = {"undotted-internal-action", "file", "syntax", "project", "known-when-run", "empty-program"}
"""What is found only without a manifest, what hides other findings and so has a file of its own, and projects."""


@pytest.fixture(autouse=True)
def _here(check: Check, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)


def kinds_promised(name: str) -> set[tuple[str, int, str]]:
    """What the comments of a program promise: ``// kind, kind``; behind a semicolon what holds without a manifest."""
    promised: set[tuple[str, int, str]] = set()
    for number, line in enumerate((FOLDER / name).read_text(encoding="utf-8").splitlines(), 1):
        words = re.findall(r"[a-z-]+", line.partition("  // ")[2].partition(";")[0].partition(" there")[0])
        promised |= {(name, number, word) for word in words if word in KINDS}
    return promised


def test_the_program_has_the_findings_that_its_comments_promise_and_every_kind_is_among_them(check: Check) -> None:
    told = check({}, "--json", "--manifest", "copter", PROGRAM).kinds
    assert told == kinds_promised("every_finding.asl")
    assert {kind for _, _, kind in told} == KINDS - ONLY_ELSEWHERE
    others = (PROGRAM, "tests/data/check/incomplete.asl", "tests/data/check/team.mas2j", "tests/data/check/empty.asl")
    assert {kind for other in others for _, _, kind in check({}, "--json", other).kinds} >= ONLY_ELSEWHERE


def test_what_hides_other_findings_is_reported_where_it_stands(check: Check) -> None:
    assert check({}, "--json", "tests/data/check/incomplete.asl").kinds == {
        ("incomplete.asl", 2, "file"),
        ("no_program.asl", 2, "syntax"),
        ("incomplete.asl", 4, "known-when-run"),
    }


def test_the_findings_read_as_written_down(check: Check) -> None:
    told = check({}, "--manifest", "copter", PROGRAM)
    assert (told.code, told.err) == (1, (FOLDER / "every_finding.out").read_text(encoding="utf-8"))


def test_the_agents_of_a_project_are_checked_as_one_team(check: Check) -> None:
    assert check({}, "--json", "tests/data/check/team.mas2j").kinds == {("team.mas2j", 3, "project")}
    alone = check({}, "--json", "tests/data/check/bob.asl").kinds
    assert alone == set(), "an agent without goals of its own waits for those of others"
