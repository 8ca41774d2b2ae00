"""One program holds every finding that `agentd check` knows; its comments say which is told in which line."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from agentd.check.finding_kinds import Kind
from tests.agentd.check.test_check import check

ROOT = Path(__file__).parents[3]
FOLDER = ROOT / "tests" / "data" / "check"
KINDS = {kind.label for kind in Kind}
ONLY_ELSEWHERE = {"undotted-internal-action", "file", "syntax", "project", "known-when-run"}
"""What is told only without a manifest, what hides other findings and so stands in a file of its own, and projects."""


@pytest.fixture(autouse=True)
def _here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)


def kinds_found(capsys: pytest.CaptureFixture[str], *args: str) -> set[tuple[str, int, str]]:
    """File, line and kind of each finding."""
    check("--json", *args)
    return {(Path(one["file"]).name, one["line"], one["kind"]) for one in json.loads(capsys.readouterr().out)}


def kinds_promised(name: str) -> set[tuple[str, int, str]]:
    """What the comments of a program promise: ``// kind, kind``; behind a semicolon what holds without a manifest."""
    promised: set[tuple[str, int, str]] = set()
    for number, line in enumerate((FOLDER / name).read_text(encoding="utf-8").splitlines(), 1):
        words = re.findall(r"[a-z-]+", line.partition("  // ")[2].partition(";")[0].partition(" there")[0])
        promised |= {(name, number, word) for word in words if word in KINDS}
    return promised


def test_the_program_has_the_findings_that_its_comments_promise_and_no_others(
    capsys: pytest.CaptureFixture[str],
) -> None:
    name = "every_finding.asl"
    told = kinds_found(capsys, "--manifest", "arducopter", f"tests/data/check/{name}")
    assert told == kinds_promised(name)


def test_every_kind_of_finding_has_its_line(capsys: pytest.CaptureFixture[str]) -> None:
    program = "tests/data/check/every_finding.asl"
    told = kinds_found(capsys, "--manifest", "arducopter", program)
    assert {kind for _, _, kind in told} == KINDS - ONLY_ELSEWHERE
    others = (program, "tests/data/check/incomplete.asl", "tests/data/check/team.mas2j")
    told = set[tuple[str, int, str]]().union(*(kinds_found(capsys, other) for other in others))
    assert {kind for _, _, kind in told} >= ONLY_ELSEWHERE


def test_what_hides_other_findings_is_told_where_it_stands(capsys: pytest.CaptureFixture[str]) -> None:
    told = kinds_found(capsys, "tests/data/check/incomplete.asl")
    assert told == {
        ("incomplete.asl", 2, "file"),
        ("no_program.asl", 2, "syntax"),
        ("incomplete.asl", 4, "known-when-run"),
    }


def test_the_findings_read_as_written_down(capsys: pytest.CaptureFixture[str]) -> None:
    assert check("--manifest", "arducopter", "tests/data/check/every_finding.asl") == 1
    assert capsys.readouterr().err == (FOLDER / "every_finding.out").read_text(encoding="utf-8")


def test_the_agents_of_a_project_are_checked_as_one_team(capsys: pytest.CaptureFixture[str]) -> None:
    assert kinds_found(capsys, "tests/data/check/team.mas2j") == {("team.mas2j", 3, "project")}
    alone = kinds_found(capsys, "tests/data/check/bob.asl")
    assert alone == set(), "an agent without goals of its own waits for those of others"
