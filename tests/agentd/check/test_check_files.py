"""What `agentd check` makes of the files that a program reads while it runs: `.include` and `.create_agent`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.agentd.check.test_check import check

MISTAKES = """
!go. !lost. ever_said.
+!go : never_said <- .print(here).
+!unused <- .print(unused).
+!round <- .print(round); !round.
"""
"""Each of these is reported of the program."""

TOLD = {"belief-never-added", "goal-without-plan", "plan-never-used", "busy-loop"}


def told(capsys: pytest.CaptureFixture[str], *files: Path) -> list[tuple[str, str, str]]:
    """Kind, severity and text of the findings."""
    check("--json", *map(str, files))
    return [(one["kind"], one["severity"], one["message"]) for one in json.loads(capsys.readouterr().out)]


@pytest.mark.parametrize("call", ['.include("more.asl")', '.create_agent(x, "more.asl")', ".create_agent(x)"])
def test_reading_a_file_that_is_there_hides_nothing(
    call: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "more.asl").write_text("other(1).\n")
    main = tmp_path / "main.asl"
    main.write_text(f"!start. +!start <- {call}.\n{MISTAKES}")
    found = told(capsys, main)
    assert {kind for kind, _, _ in found} == TOLD
    assert [severity for kind, severity, _ in found if kind == "goal-without-plan"] == ["error"]


def test_what_an_included_file_holds_counts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "more.asl").write_text("never_said. !unused. +!lost <- !round.\n")
    main = tmp_path / "main.asl"
    main.write_text(f'!start. +!start <- .include("more.asl").\n{MISTAKES}')
    assert {kind for kind, _, _ in told(capsys, main)} == {"busy-loop"}


@pytest.mark.parametrize("call", ['.include("moer.asl")', '.create_agent(x, "moer.asl")'])
def test_a_file_that_is_missing_is_told_with_the_near_one(
    call: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "more.asl").write_text("other(1).\n")
    main = tmp_path / "main.asl"
    main.write_text(f"!start. +!start <- {call}.\n")
    ((kind, severity, message),) = told(capsys, main)
    assert (kind, severity) == ("file", "error")
    assert '"moer.asl": No such file' in message
    assert message.endswith("; did you mean more.asl?")


def test_a_created_agent_is_one_of_the_team(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "helper.asl").write_text("!help. +!help <- .send(main, tell, heard); .send(main, achieve, answer).\n")
    main = tmp_path / "main.asl"
    main.write_text('!start. +!start : not heard <- .create_agent(h, "helper.asl").\n+!answer. +!never.\n')
    ((kind, _, message),) = told(capsys, main)
    assert kind == "plan-never-used"
    assert "!never" in message


@pytest.mark.parametrize("call", [".include(F)", ".create_agent(x, F)"])
def test_a_file_that_only_the_run_knows_is_said_once(
    call: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main = tmp_path / "main.asl"
    main.write_text(f"file(a). !start. +!start : file(F) <- {call}; {call}.\n{MISTAKES}")
    found = told(capsys, main)
    assert [severity for kind, severity, _ in found if kind == "known-when-run"] == ["info"]
    assert "busy-loop" in {kind for kind, _, _ in found}, "what needs nothing but the plan is told all the same"


@pytest.mark.parametrize("name", ['"new.asl"', "F"])
def test_a_file_that_the_program_saves_itself_need_not_be_there(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main = tmp_path / "main.asl"
    main.write_text(
        f'file("new.asl"). !start. +!start : file(F) <- .print(F); .save_agent({name}); .include("new.asl").\n'
    )
    ((kind, severity, _),) = told(capsys, main)
    assert (kind, severity) == ("known-when-run", "info")
