"""`argosy why`: what is said of names of every kind, and of agents that are not there or remember nothing."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.argosy.why.asked import MISSION, agent, eventually, told, why
from tests.support.processes import ROOT

PROGRAM = """\
battery(12).
found(3, boat).
!serve.
+!serve <- !step(3); .wait(60000).
+!step(0).
+!step(N) : battery(B) & B > N <- !step(N - 1).
+!dive(Depth) <- go_down(Depth).
+!lost.
+victim(V) <- !dive(V).
"""


def test_names_of_every_kind_are_explained(tmp_path: Path, endpoint: str) -> None:
    with agent(tmp_path, endpoint, PROGRAM):
        text = eventually(lambda: told(endpoint, "uav"), lambda text: "!serve has waited" in text)
        assert text == (
            "uav waits for something to happen (mission second T, cycle C). It runs uav.asl.\n\n"
            "!serve has waited for S s for 60 s to pass (.wait) at uav.asl:4.\n"
            "  !serve is an initial belief or goal of the program.\n"
        )
        assert told(endpoint, "uav", "!step(0)") == (
            "S s ago (mission second T): for the goal !step(0) the plan +!step(0) (uav.asl:5) was chosen.\n"
            "  Not tried: +!step(N) (uav.asl:6).\n"
            "  The plan for !step(1) set it at uav.asl:6.\n"
            "  The plan for !serve set the goal !step(3) at uav.asl:4.\n"
            "  This loop ran 2 times before, as far as is remembered.\n"
            "  The goal !serve is an initial belief or goal of the program.\n"
            "  The plan has ended.\n"
        )
        believed = told(endpoint, "uav", "found")
        assert believed.startswith("found(3,boat)[source(self)] is believed now: the agent's own")
        assert "\n  It is believed, but no plan is for +found/2: nothing is done when it comes.\n" in believed
        assert told(endpoint, "uav", "dive") == (
            "1 plan for it: +!dive(Depth) (uav.asl:7).\n"
            "None of the last 5 decisions was about !dive.\n"
            "  !dive/1 is at uav.asl:9, in the plan +victim(V) (uav.asl:9), which was not chosen lately: nothing "
            "triggered it.\n"
        )
        assert told(endpoint, "uav", "go_down/1") == (
            "None of the last 5 decisions was about go_down.\n"
            "  go_down/1 is performed at uav.asl:7, in the plan +!dive(Depth) (uav.asl:7), which was not chosen "
            "lately: nothing triggered it.\n"
        )
        assert told(endpoint, "uav", "!lost") == (
            "1 plan for it: +!lost (uav.asl:8).\n"
            "None of the last 5 decisions was about !lost.\n"
            "  No plan of the agent raises it: others must ask for it.\n"
        )
        for meant in ("victim", "battery"):
            miss = meant[:2] + meant[3:]
            text = f"uav has nothing called `{miss}`, did you mean `{meant}`?\n"
            assert why(endpoint, "uav", miss) == (1, text, "")
        with Path("/dev/full").open("w") as full:
            command = [sys.executable, "-m", "argosy", "why", "uav", "--router", endpoint]
            done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60, cwd=ROOT)
        assert (done.returncode, done.stderr) == (1, "error: the output cannot be written: No space left on device\n")
        code, text, _ = why(endpoint, "uav", "!step(0)", "--json")
        data = json.loads(text)
        assert (code, data["agent"], data["about"]) == (0, "uav", "!step(0)")
        (paragraph,) = data["paragraphs"]
        assert paragraph["kind"] == "decision"
        assert paragraph["lines"][0]["position"].endswith("uav.asl:5")
        code, text, error = why(endpoint, "uaw")
        assert (code, text) == (1, "")
        assert error == "error: there is no agent `uaw`, did you mean `uav`?\n"


def test_an_agent_that_remembers_no_decisions_says_so(tmp_path: Path, endpoint: str) -> None:
    with agent(tmp_path, endpoint, PROGRAM, "--decisions", "0"):
        text = eventually(lambda: told(endpoint, "uav"), lambda text: "!serve has waited" in text)
    assert text == (
        "uav waits for something to happen (mission second T, cycle C). It runs uav.asl.\n\n"
        "!serve has waited for S s for 60 s to pass (.wait) at uav.asl:4.\n\n"
        "It remembers no decisions: none was made since its start, or it was started with --decisions 0.\n"
    )


@pytest.mark.parametrize(
    ("arguments", "code", "problem"),
    [
        (["uav", "A b"], 2, "argosy why: error: `A b`: expected the name of a goal, a belief or an action: go, go/1, "),
        (["uav", "go("], 2, "argosy why: error: `go(`: expected the name of a goal"),
    ],
)
def test_what_prevents_an_explanation_is_said(endpoint: str, arguments: list[str], code: int, problem: str) -> None:
    got, text, error = why(endpoint, *arguments)
    assert (got, text) == (code, "")
    assert problem in error


def test_nobody_is_there(tmp_path: Path, endpoint: str) -> None:
    from tests.support.processes import running

    path = tmp_path / "why.yaml"
    path.write_text(MISSION)
    (tmp_path / "uav.asl").write_text(PROGRAM)
    with running("commd", "serve", str(path), "--state", str(tmp_path), "--router", endpoint) as board:
        board.says("router board=")
        code, _, error = why(endpoint, "uav")
    assert code == 1
    assert error == "error: no agent is on the bus: is agentd running, and is this its router?\n"
