"""What a beginner reads when a plan fails: the exact text of each situation."""

from __future__ import annotations

from pathlib import Path

import pytest

from agentd.conversion.log_format import lines_of
from agentd.language.compiler.compile import compile_program
from agentd.language.parse import parse_program
from agentd.mind import Mind
from agentd.mind.data.effects import Log, PerformAction
from agentd.mind.data.inputs import ActionDone
from tests.agentd.minds import World

REPORTS = {
    "a constraint": """
!start.
+!start <- !check(1).
+!check(X) <-
   .print("checking"); X > 3.
""",
    "a test of a belief that has other arguments": """
position(1,2). position(3,4).
!start.
+!start <- ?position(7,Y).
""",
    "a test of a misspelt belief": """
battery(80).
!start.
+!start <- ?batery(B).
""",
    "a test with another number of arguments": """
position(1,2).
!start.
+!start <- ?position(P).
""",
    "a compound test": """
battery(80).
!start.
+!start <- ?(battery(B) & B > 90).
""",
    "an internal action that says no": """
!start.
+!start <- .member(3, [1,2]).
""",
    "an internal action with a wrong argument": """
!start.
+!start <- .nth(9, [a,b], X).
""",
    "a misspelt internal action": """
!start.
+!start <- .pirnt("hello").
""",
    "an action that the vehicle refuses": """
!start.
+!start <- takeoff(5).
""",
    "a misspelt goal": """
!start.
+!start <- !gto(3).
+!goto(X).
""",
    "a goal with another number of arguments": """
!start.
+!start <- !goto(1,2).
+!goto(X).
""",
    "a goal that no plan is applicable for": """
battery(12). position(1,2).
!start.
+!start <- !fly(5).
@careful +!fly(H) : battery(B) & B > 20.
+!fly(H) : position(X,Y) & Y > H.
+!fly(home).
+!fly(H) : .random(R) & R > 2.
""",
    "a failure plan that does not fit": """
!start.
+!start <- !fly.
+!fly <- ?height(H).
-!fly[reason(R)] <- .print(R).
-!fly : battery(B) <- .print(B).
""",
    "a failure in a failure plan": """
!start.
+!start <- !fly.
+!fly <- .fail.
-!fly <- .send(bbo, tell, failed).
""",
    "a division by zero": """
!start.
+!start <- X = 10 div 0; .print(X).
""",
    "a variable without a value": """
!start.
+!start <- !Goal.
""",
    "a failure on purpose": """
!start.
+!start <- .fail(reason(wind), error_msg("too windy to fly")).
""",
    "a context that cannot be computed": """
!start.
+!start : X = 1 div 0.
""",
    "a goal far down": """
!a.
+!a <- !b; .print(a).
+!b <- !c; .print(b).
+!c <- !d(1,"x",[1,2,3]); .print(c).
+!d(X,Y,Z) <- false.
""",
}

EXPECTED = Path(__file__).parents[1] / "failure_reports"


def report(source: str, tmp_path: Path) -> str:
    """Everything that is told while a program runs, as `agentd run` shows it."""
    path = tmp_path / "fly.asl"
    path.write_text(source.lstrip("\n"))
    program = compile_program(parse_program(path.read_text(), str(path)))
    world = World(Mind("bob", program, agents=lambda: ["bob", "ann"])).settle()
    for action in world.of(PerformAction):
        name = action.name
        reason = "PreArm: need 3D fix" if name == "takeoff" else f"there is no environment that could perform {name}"
        world.feed(ActionDone(action.id, False, reason, "refused" if name == "takeoff" else ""))
    text = "".join(f"{line}\n" for note in world.of(Log) for line in lines_of(note))
    return text.replace(str(path), "fly.asl")


@pytest.mark.parametrize("situation", REPORTS)
def test_a_failure_is_told_in_these_words(situation: str, tmp_path: Path) -> None:
    expected = (EXPECTED / f"{situation.replace(' ', '_')}.txt").read_text()
    assert report(REPORTS[situation], tmp_path) == expected


def test_recording_decisions_changes_no_report(tmp_path: Path) -> None:
    """The reasons that are found afterwards are those that a mind with records has noted."""
    for situation, source in REPORTS.items():
        if ".random" in source:
            continue  # asked once only, so without a record nobody knows
        path = tmp_path / "fly.asl"
        path.write_text(source)
        notes = []
        for decisions in (0, 50):
            program = compile_program(parse_program(source, str(path)))
            world = World(Mind("bob", program, agents=lambda: ["bob", "ann"], decisions=decisions)).settle()
            notes.append([lines_of(note) for note in world.of(Log)])
        assert notes[0] == notes[1], situation
