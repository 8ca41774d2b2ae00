"""``agentd run``: output, exit codes, messages between agents, sleeping."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import psutil
import pytest

from tests.agentd.conftest import Command, Ran

Run: TypeAlias = Callable[..., Ran]


@pytest.fixture
def run(command: Command) -> Run:
    """Run the program agent.asl, with others that are given by their names, until it is idle."""

    def run(program: str, *arguments: str, **others: str) -> Ran:
        files = {f"{name}.asl": text for name, text in {"agent": program, **others}.items()}
        return command(files, "run", "--exit-when-idle", *files, *arguments)

    return run


def started(folder: Path, program: str) -> subprocess.Popen[bytes]:
    """Start the program agent.asl in a process of its own."""
    (folder / "agent.asl").write_text(program)
    command = [sys.executable, "-m", "agentd", "run", str(folder / "agent.asl")]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def test_prints_go_to_stdout_with_the_agents_name_and_nothing_else_does(command: Command) -> None:
    program = '!s. +!s <- .print("a"); .print("b\\nc"); +x; .fail.'
    ran = command({"a.asl": program}, "run", "bob=a.asl", "--exit-when-idle")
    assert (ran.code, ran.out) == (0, "[bob] a\n[bob] b\nc\n")
    assert "ia_failed" in ran.err


PRINTS = {
    "an agent without a name is named after its file": ("!s. +!s <- .my_name(N); .print(N).", "agent"),
    "an external action fails for want of an environment": (
        "!s. +!s <- fly(1). -!s[error(E)] <- .print(E).",
        "action_failed",
    ),
    "a misspelt internal action is reported with what is wrong": (
        '!s. +!s <- .prnt(1). -!s[error(E), error_msg(M)] <- .print(E, " ", M).',
        "action_failed there is no internal action .prnt/1, did you mean `.print`?",
    ),
    "a length of a number": ("!s. +!s <- .length(5, L). -!s[error_msg(M)] <- .print(M).", ".length(5,L) did not hold"),
    "the greatest of nothing": ("!s. +!s <- .max([], X). -!s[error_msg(M)] <- .print(M).", ".max([],X) did not hold"),
    "a constraint has no message": ('!s. +!s <- X = 2; X > 3. -!s[error_msg(M)] <- .print("<", M, ">").', "<>"),
    "nor has a failure on purpose": ('!s. +!s <- .fail. -!s[error_msg(M)] <- .print("<", M, ">").', "<>"),
    "a test": ("!s. +!s <- ?absent(q). -!s[error_msg(M)] <- .print(M).", "Failed to test 'absent(q)'"),
}


@pytest.mark.parametrize("what", PRINTS)
def test_a_program_prints_and_a_failure_says_of_what(what: str, run: Run) -> None:
    program, printed = PRINTS[what]
    assert run(program).lines == [f"[agent] {printed}"]


def test_a_misspelt_internal_action_is_none_of_an_environment(run: Run) -> None:
    Path("bare_world.py").write_text("from agentd import Environment\nclass World(Environment):\n    pass\n")
    program, printed = PRINTS["a misspelt internal action is reported with what is wrong"]
    assert run(program, "--env", "bare_world.py:World").lines == [f"[agent] {printed}"]


def test_a_timeout_ends_with_one_and_says_so(run: Run) -> None:
    ran = run("!s. +!s <- .wait(60000).", "--timeout", "0.3")
    assert (ran.code, ran.err) == (1, "agentd: not done after 0.3 s\n")


def test_a_file_that_does_not_parse_ends_with_two_the_line_and_a_caret(run: Run) -> None:
    ran = run('!s.\n+!s <- .print("a") .print("b").\n')
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.startswith("agent.asl:2:20: error:")
    assert "^" in ran.err


def test_what_is_wrong_with_each_of_several_programs_is_reported_together(run: Run) -> None:
    ran = run("+!g <- a b.", b="+!g : c, d.", c="{ inculde(x) }", d="!g.")
    assert ran.code == 2
    for name, message in (("agent", "a ; is missing"), ("b", "not by a comma"), ("c", "did you mean `include`?")):
        assert any(line.startswith(f"{name}.asl:1") and message in line for line in ran.err.splitlines()), message


def test_a_missing_file_and_a_missing_include_end_with_two(command: Command, run: Run) -> None:
    assert command({}, "run", "nowhere.asl").code == 2
    ran = run('{ include("nowhere.asl") }')
    assert ran.code == 2
    assert ran.err.startswith("agent.asl:1:1: error: cannot include")


def test_agents_send_one_another_messages(run: Run) -> None:
    ping = "!s. +!s <- .send(pong, tell, ball(1)). +ball(N)[source(S)] <- .print(N, S); .stopMAS."
    assert run(ping, pong="+ball(N) <- .send(agent, tell, ball(N+1)).").out == "[agent] 2pong\n"


def test_a_reader_who_leaves_ends_the_run_without_a_traceback(tmp_path: Path) -> None:
    with started(tmp_path, '!s. +!s <- .print("on and on"); !s.') as process:
        assert process.stdout.readline() == b"[agent] on and on\n"
        process.stdout.close()
        _, said = process.communicate(timeout=60)
    assert (process.returncode, said) == (1, b"")


def test_a_waiting_agent_sleeps(tmp_path: Path) -> None:
    with started(tmp_path, "!s. +!s <- .print(ready); .wait(600000).") as process:
        assert process.stdout.readline() == b"[agent] ready\n"
        watched = psutil.Process(process.pid)
        before = watched.cpu_times()
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(timeout=1.0)
        after = watched.cpu_times()
        process.terminate()
    assert (after.user + after.system) - (before.user + before.system) < 0.1


WAITS = """!a. !b. !c. !d. !e. !f.
@f[atomic] +!f <- !!later(1); .suspend(later(_)).
+!later(_).
+!a <- .wait("+never").
+!b <- !sub(3).
+!sub(N) <- .wait(flag(N)).
+!c <- .suspend; .print(no).
+!d <- { .wait("+x") |&| .print(hi) }.
+!e <- .send(bob, askOne, x(_), _).
"""


def test_what_still_waits_when_nothing_is_left_to_do_is_reported(run: Run) -> None:
    bob = "+?x(_) <- .wait({+never})."
    ran = run(WAITS, bob=bob)
    assert (ran.code, ran.out) == (0, "[agent] hi\n")
    assert [line.partition("warning: ")[2] for line in ran.err.splitlines() if "warning: " in line] == [
        'agent.asl:4:8: .wait("+never") waits for what cannot come any more',
        "agent.asl:6:13: .wait(flag(3)) waits for what cannot come any more",
        "agent.asl:7:8: the intention was suspended after .suspend, and nothing resumes it",
        "agent.asl:9:8: .send(bob,askOne,x(_),_) waits for what cannot come any more",
        'agent.asl:8:10: .wait("+x") waits for what cannot come any more',
        "+!later(1) was suspended before it began, and nothing resumes it",
        "bob.asl:1:11: .wait({ +never }) waits for what cannot come any more",
    ]
    assert "in the plan for +!sub(3) (agent.asl:6), called by +!b (agent.asl:5)" in ran.err
    assert run(WAITS, "--fail-on-error", bob=bob).code == 1


def test_of_many_that_wait_the_number_is_reported(run: Run) -> None:
    ran = run('!s. +!s <- for (.range(N, 1, 25)) { !!w(N) }. +!w(N) <- .wait("+never").')
    assert ran.err.count("waits for what cannot come any more") == 10
    assert "15 more intentions wait as these do" in ran.err


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("!s. +!s <- .print(x).", 0),
        ("!s. +!s <- .fail. -!s <- .print(handled).", 0),
        ("!s. +!s <- .fail; .print(x).", 1),
        ("!s. +!s <- !nothing.", 1),
        ("!nothing.", 1),
        ("!s. +!s <- .fail. -!s : false <- .print(x).", 1),
        ("!s. +!s <- !!t; .wait(50); .stopMAS. +!t <- .fail.", 1),
        ("!s. +!s <- !!t; .wait(50); .stopMAS(0, 3). +!t <- .fail.", 3),
    ],
)
def test_an_exit_code_tells_failures_to_those_who_ask(text: str, code: int, run: Run) -> None:
    assert run(text, "--fail-on-error").code == code
    assert run(text).code == (code if code == 3 else 0)


def test_the_report_of_what_only_said_no_does_not_say_it_twice(run: Run) -> None:
    told = run("!s. +!s <- .max([], X). -!s : false <- .print(x).").err
    assert told.startswith("[agent] warning: agent.asl:1: .max([],X) does not succeed\n")
