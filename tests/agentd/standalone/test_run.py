"""``agentd run``: output, exit codes, messages between agents, sleeping."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import psutil
import pytest


def _run(*arguments: str | Path, timeout: float = 60) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "agentd", "run", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout, check=False)


@pytest.fixture
def program(tmp_path: Path):
    def write(text: str, name: str = "agent.asl") -> Path:
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


def test_prints_go_to_stdout_with_the_agents_name_and_nothing_else_does(program) -> None:
    path = program('!s. +!s <- .print("a"); .print("b\\nc"); +x; .fail.')
    done = _run(f"bob={path}", "--exit-when-idle")
    assert done.stdout == "[bob] a\n[bob] b\nc\n"
    assert "ia_failed" in done.stderr
    assert done.returncode == 0


def test_an_agent_without_a_name_is_named_after_its_file(program) -> None:
    done = _run(program("!s. +!s <- .my_name(N); .print(N); .stopMAS.", "scout.asl"))
    assert done.stdout == "[scout] scout\n"


def test_stopping_the_team_ends_with_its_exit_code(program) -> None:
    assert _run(program("!s. +!s <- .stopMAS.")).returncode == 0
    assert _run(program("!s. +!s <- .stopMAS(0, 3).")).returncode == 3


def test_a_timeout_ends_with_one_and_says_so(program) -> None:
    done = _run(program("!s. +!s <- .wait(60000)."), "--timeout", "0.3")
    assert done.returncode == 1
    assert "not done after 0.3 s" in done.stderr


def test_a_file_that_does_not_parse_ends_with_two_the_line_and_a_caret(program) -> None:
    path = program('!s.\n+!s <- .print("a") .print("b").\n')
    done = _run(path)
    assert done.returncode == 2
    assert f"{path}:2:" in done.stderr
    assert "error:" in done.stderr
    assert "^" in done.stderr
    assert done.stdout == ""


def test_what_is_wrong_with_each_of_several_programs_is_told_at_once(program) -> None:
    wrong = [program("+!g <- a b.", "a.asl"), program("+!g : c, d.", "b.asl"), program("{ inculde(x) }", "c.asl")]
    done = _run(*wrong, program("!g.", "d.asl"))
    assert done.returncode == 2
    for path, message in zip(wrong, ("a ; is missing", "not by a comma", "did you mean include?"), strict=True):
        assert any(line.startswith(f"{path}:1") and message in line for line in done.stderr.splitlines()), message


def test_a_missing_file_and_a_missing_include_end_with_two(program, tmp_path: Path) -> None:
    assert _run(tmp_path / "nowhere.asl").returncode == 2
    done = _run(program('{ include("nowhere.asl") }'))
    assert done.returncode == 2
    assert "agent.asl:1:" in done.stderr


def test_agents_send_one_another_messages(program) -> None:
    ping = program("!s. +!s <- .send(pong, tell, ball(1)). +ball(N)[source(S)] <- .print(N, S); .stopMAS.", "ping.asl")
    pong = program("+ball(N) <- .send(ping, tell, ball(N+1)).", "pong.asl")
    assert _run(ping, pong).stdout == "[ping] 2pong\n"


def test_an_unanswered_question_ends_at_its_time_limit(program) -> None:
    ann = program("!s. +!s <- .send(bob, askOne, q(_), A, 200); .print(A); .stopMAS.", "ann.asl")
    bob = program("+?q(X) <- .wait(60000); X = 1.", "bob.asl")
    assert _run(ann, bob).stdout == "[ann] timeout\n"


def test_an_external_action_fails_because_there_is_no_environment(program) -> None:
    done = _run(program("!s. +!s <- fly(1). -!s[error(E)] <- .print(E)."), "--exit-when-idle")
    assert done.stdout == "[agent] action_failed\n"


def test_a_reader_who_leaves_ends_the_run_without_a_traceback(program) -> None:
    command = [sys.executable, "-m", "agentd", "run", str(program('!s. +!s <- .print("on and on"); !s.'))]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"[agent] on and on\n"
        process.stdout.close()
        _, said = process.communicate(timeout=60)
    assert (process.returncode, said) == (1, b"")


def test_a_waiting_agent_sleeps(program) -> None:
    path = program("!s. +!s <- .print(ready); .wait(600000).")
    with subprocess.Popen([sys.executable, "-m", "agentd", "run", str(path)], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"[agent] ready\n"
        watched = psutil.Process(process.pid)
        before = watched.cpu_times()
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(timeout=1.0)
        after = watched.cpu_times()
        process.terminate()
    assert (after.user + after.system) - (before.user + before.system) < 0.1


def test_what_still_waits_when_nothing_is_left_to_do_is_told(program) -> None:
    path = program(
        """!a. !b. !c. !d. !e. !f.
@f[atomic] +!f <- !!later(1); .suspend(later(_)).
+!later(_).
+!a <- .wait("+never").
+!b <- !sub(3).
+!sub(N) <- .wait(flag(N)).
+!c <- .suspend; .print(no).
+!d <- { .wait("+x") |&| .print(hi) }.
+!e <- .send(bob, askOne, x(_), _).
"""
    )
    bob = program("+?x(_) <- .wait({+never}).", "bob.asl")
    done = _run(path, bob, "--exit-when-idle")
    assert (done.stdout, done.returncode) == ("[agent] hi\n", 0)
    told = [line for line in done.stderr.splitlines() if "warning: " in line]
    assert [line.partition("warning: ")[2].removeprefix(f"{path.parent}/") for line in told] == [
        'agent.asl:4:8: .wait("+never") waits for what cannot come any more',
        "agent.asl:6:13: .wait(flag(3)) waits for what cannot come any more",
        "agent.asl:7:8: the intention was suspended after .suspend, and nothing resumes it",
        "agent.asl:9:8: .send(bob,askOne,x(_),_) waits for what cannot come any more",
        'agent.asl:8:10: .wait("+x") waits for what cannot come any more',
        "+!later(1) was suspended before it began, and nothing resumes it",
        "bob.asl:1:11: .wait({ +never }) waits for what cannot come any more",
    ]
    assert f"in the plan for +!sub(3) ({path}:6), called by +!b ({path}:5)" in done.stderr
    assert _run(path, bob, "--exit-when-idle", "--fail-on-error").returncode == 1


def test_of_many_that_wait_the_number_is_told(program) -> None:
    path = program('!s. +!s <- for (.range(N, 1, 25)) { !!w(N) }. +!w(N) <- .wait("+never").')
    done = _run(path, "--exit-when-idle")
    assert done.stderr.count("waits for what cannot come any more") == 10
    assert "15 more intentions wait as these do" in done.stderr


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
def test_an_exit_code_tells_failures_to_those_who_ask(program, text: str, code: int) -> None:
    path = program(text)
    assert _run(path, "--exit-when-idle", "--fail-on-error").returncode == code
    assert _run(path, "--exit-when-idle").returncode == (code if code == 3 else 0)


def test_a_handler_of_a_misspelt_internal_action_is_told_what_is_wrong(program) -> None:
    path = program("!s. +!s <- .prnt(1). -!s[error(E), error_msg(M)] <- .print(E, ' ', M).".replace("'", '"'))
    expected = "[agent] action_failed there is no internal action .prnt/1; did you mean .print?\n"
    assert _run(path, "--exit-when-idle").stdout == expected
    (path.parent / "world.py").write_text("from agentd import Environment\nclass World(Environment):\n    pass\n")
    assert _run(path, "--exit-when-idle", "--env", f"{path.parent}/world.py:World").stdout == expected


@pytest.mark.parametrize(
    ("formula", "message"),
    [
        (".length(5, L)", ".length(5,L) did not hold"),
        (".max([], X)", ".max([],X) did not hold"),
        ("X = 2; X > 3", ""),
        (".fail", ""),
        ("?absent(q)", "Failed to test 'absent(q)'"),
    ],
)
def test_a_failure_that_only_says_no_says_of_what(program, formula: str, message: str) -> None:
    path = program(f'!s. +!s <- {formula}. -!s[error_msg(M)] <- .print("<", M, ">").')
    assert _run(path, "--exit-when-idle").stdout == f"[agent] <{message}>\n"


def test_the_report_of_what_only_said_no_does_not_say_it_twice(program) -> None:
    done = _run(program("!s. +!s <- .max([], X). -!s : false <- .print(x)."), "--exit-when-idle")
    assert "agent.asl:1:0: .max([],X) does not succeed\n" in done.stderr.replace("agent.asl:1: ", "agent.asl:1:0: ")
