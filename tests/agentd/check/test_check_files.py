"""What `agentd check` makes of the files that a program reads while it runs: `.include` and `.create_agent`."""

import pytest

from tests.agentd.check.conftest import Check

MISTAKES = """
!go. !lost. ever_said.
+!go : never_said <- .print(here).
+!unused <- .print(unused).
+!round <- .print(round); !round.
"""
"""Each of these is reported of the program."""

KINDS = {"belief-never-added", "goal-without-plan", "plan-never-used", "busy-loop"}


@pytest.mark.parametrize("call", ['.include("more.asl")', '.create_agent(x, "more.asl")', ".create_agent(x)"])
def test_reading_a_file_that_is_there_hides_nothing(call: str, check: Check) -> None:
    told = check({"main.asl": f"!start. +!start <- {call}.\n{MISTAKES}", "more.asl": "other(1).\n"}, "--json")
    assert {one["kind"] for one in told.findings} == KINDS
    assert [one["severity"] for one in told.findings if one["kind"] == "goal-without-plan"] == ["error"]


def test_what_an_included_file_holds_counts(check: Check) -> None:
    main = f'!start. +!start <- .include("more.asl").\n{MISTAKES}'
    told = check({"main.asl": main, "more.asl": "never_said. !unused. +!lost <- !round.\n"}, "--json")
    assert {one["kind"] for one in told.findings} == {"busy-loop"}


@pytest.mark.parametrize("call", ['.include("moer.asl")', '.create_agent(x, "moer.asl")'])
def test_a_file_that_is_missing_is_reported_with_the_near_one(call: str, check: Check) -> None:
    told = check({"main.asl": f"!start. +!start <- {call}.\n", "more.asl": "other(1).\n"}, "--json")
    (one,) = told.findings
    assert (one["kind"], one["severity"]) == ("file", "error")
    assert '"moer.asl": No such file' in one["message"]
    assert one["message"].endswith(", did you mean `more.asl`?")


def test_a_created_agent_is_one_of_the_team(check: Check) -> None:
    helper = "!help. +!help <- .send(main, tell, heard); .send(main, achieve, answer).\n"
    main = '!start. +!start : not heard <- .create_agent(h, "helper.asl").\n+!answer. +!never.\n'
    (one,) = check({"main.asl": main, "helper.asl": helper}, "--json").findings
    assert one["kind"] == "plan-never-used"
    assert "!never" in one["message"]


@pytest.mark.parametrize("call", [".include(F)", ".create_agent(x, F)"])
def test_a_file_that_only_the_run_knows_is_said_once(call: str, check: Check) -> None:
    told = check(f"file(a). !start. +!start : file(F) <- {call}; {call}.\n{MISTAKES}", "--json")
    assert [one["severity"] for one in told.findings if one["kind"] == "known-when-run"] == ["info"]
    assert "busy-loop" in {one["kind"] for one in told.findings}, (
        "what needs nothing but the plan is reported all the same"
    )


@pytest.mark.parametrize("name", ['"new.asl"', "F"])
def test_a_file_that_the_program_saves_itself_need_not_be_there(name: str, check: Check) -> None:
    run = f'+!start : file(F) <- .print(F); .save_agent({name}); .include("new.asl").\n'
    (one,) = check(f'file("new.asl"). !start. {run}', "--json").findings
    assert (one["kind"], one["severity"]) == ("known-when-run", "info")
