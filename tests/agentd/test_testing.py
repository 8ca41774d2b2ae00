"""``agentd test``: which plans are tests, how they are run, what is reported of them."""

import errno
import os
import re
import time
from itertools import takewhile
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tests.agentd.conftest import Command, Ran, agentd

REPOSITORY = Path(__file__).parents[2]


class Reported(Ran):
    """What the command printed, by test."""

    @property
    def lines(self) -> list[str]:
        """The lines of the tests."""
        return [line for line in self.out.splitlines() if re.match(r"(ok|FAIL|ERROR|TIMEOUT) +\S+:\d+ ", line)]

    @property
    def summary(self) -> str:
        return self.out.strip().splitlines()[-1] if self.out.strip() else ""

    def verdict(self, name: str) -> str:
        (line,) = [line for line in self.lines if line.split()[2].rstrip(":") == name]
        return line.split()[0]

    def details(self, name: str) -> list[str]:
        """The indented lines about a test that did not pass."""
        lines = self.out.splitlines()
        (head,) = [n for n, line in enumerate(lines) if re.fullmatch(rf"[A-Z]+ \S+:\d+: {re.escape(name)}", line)]
        return [line.strip() for line in takewhile(lambda line: line.startswith("    "), lines[head + 1 :])]


@pytest.fixture
def run(command: Command):
    """Run the tests of a program, beside other files."""

    def run(program: str | None, *arguments: str, name: str = "some_test.asl", **files: str) -> Reported:
        if program is not None:
            files, arguments = {name: program, **files}, (name, *arguments)
        ran = command(files, "test", *arguments)
        return Reported(ran.code, ran.out, ran.err)

    return run


def test_plans_with_the_annotation_test_are_run_and_only_they(run) -> None:
    ran = run(
        """
        double(X, Y) :- Y = 2 * X.
        @doubles[test] +!doubles <- ?double(2, Y); !assert_equals(4, Y).
        @[test] +!nameless(X) : double(1, 2) <- !force_pass.
        @[slow, test(integration)] +!with_more(X) <- !force_pass.
        @fly +!fly <- .fail.
        +!plain <- .fail.
        """
    )
    assert ran.lines == [
        "ok      some_test.asl:3 doubles",
        "ok      some_test.asl:4 nameless(X)",
        "ok      some_test.asl:5 with_more(X)",
    ]
    assert ran.code == 0
    assert re.fullmatch(r"3 tests: 3 passed \(\d+\.\d s\)", ran.summary)


def test_a_plan_whose_annotation_is_a_misspelt_test_is_an_error(run) -> None:
    ran = run("@a[test] +!a <- !force_pass.\n@b[tset] +!b <- !force_failure.\n@c[best] +!c <- .fail.\n")
    assert (ran.code, len(ran.lines)) == (2, 1)
    assert ran.err == "some_test.asl:2:4: error: this plan is no test: did you mean `[test]`, not `[tset]`?\n"
    alone = run(None, "folder", **{"folder/alone.asl": "@b[tset] +!b <- !assert_true(false).\n"})
    assert (alone.code, alone.err.count("[tset]")) == (2, 1)


ASSERTIONS = [
    ("!assert_equals(3, 1 + 2)", None),
    ("!assert_equals(f(X, [a]), f(X, [a]))", None),
    ('!assert_equals("a", a)', 'expected "a", got a'),
    ("!assert_equals(p[x], p)", "expected p[x], got p"),
    ("!assert_equals(3, 3.05, 0.1)", None),
    ("!assert_equals(3, 3.5, 0.1)", "expected 3 within 0.1, got 3.5, which is 0.5 away"),
    ("!assert_equals(a, 3, 0.1)", "expected a within 0.1, got 3: only numbers have a distance"),
    ("!assert_not_equals(a, b)", None),
    ("!assert_not_equals(a, a)", "expected anything but a"),
    ("!assert_true(known(1))", None),
    ("!assert_true(known(2))", "expected that known(2) holds; it does not"),
    ("!assert_true(1 < 2 & not known(2))", None),
    ("!assert_true(.member(2, [1,2]))", None),
    ("!assert_true(derived(1))", None),
    ("!assert_true(true)", None),
    ("!assert_true(false)", "expected that false holds; it does not"),
    ("!assert_false(known(2))", None),
    ("!assert_false(known(_))", "expected that known(_) does not hold; it does"),
    ("!assert_equals([a,b], [b,a])", "expected [a,b], got [b,a]"),
    ("!assert_greater_than(2, 1)", None),
    ("!assert_greater_than(1, 1)", "expected 1 > 1"),
    ("!assert_greater_than_equals(1, 1)", None),
    ("!assert_greater_than_equals(1, 2)", "expected 1 >= 2"),
    ("!assert_between(2, 1, 2)", None),
    ("!assert_between(3, 1, 2)", "expected 1 <= 3 <= 2"),
    ("!assert_between(a, 1, 2)", "expected 1 <= a <= 2: only numbers have an order"),
    ("!assert_contains([a, b(1)], b(_))", None),
    ('!assert_contains("hello", "ell")', None),
    ("!assert_contains([a], c)", "expected c in [a]; it is not there"),
    ("!assert_not_contains([a], c)", None),
    ("!assert_not_contains([a], a)", "expected no a in [a]; it is there"),
    (".set.create(S); .set.add(S, a); !assert_contains(S, a)", None),
    ("!force_pass", None),
    ("!force_failure", "the test plan forces a failure"),
    ('!force_failure("not yet")', "not yet"),
]


@pytest.mark.parametrize(("body", "message"), ASSERTIONS)
def test_an_assertion_holds_or_says_what_was_expected_and_what_was_there(run, body: str, message: str | None) -> None:
    ran = run(f"known(1). derived(X) :- known(X).\n@t[test] +!t <- {body}.\n")
    if message is None:
        assert (ran.code, ran.verdict("t")) == (0, "ok"), ran.out
    else:
        assert ran.code == 1
        assert ran.lines == [f"FAIL    some_test.asl:2 t: {message}"]


def test_a_failed_assertion_names_its_line_its_formula_its_values_and_the_goals_that_led_to_it(run) -> None:
    ran = run(
        """@outer[test] +!outer
  <- X = 3;
     .print("X is ", X);
     !inner(X).
+!inner(N)
  <- !assert_equals(4, N).
"""
    )
    assert ran.details("outer") == [
        "expected 4, got 3",
        "at some_test.asl:6: <- !assert_equals(4, N).",
        "that is: !assert_equals(4,3)",
        "for +!inner(3) (some_test.asl:5)",
        "for +!outer (some_test.asl:1)",
        "its output:",
        "[some_test] X is 3",
    ]


def test_a_failed_assertion_fails_the_test_even_where_the_program_handles_the_failure(run) -> None:
    ran = run(
        """
        @t[test] +!t <- !risky; !force_pass.
        +!risky <- !assert_true(false).
        -!risky <- .print(handled).
        """
    )
    assert (ran.code, ran.verdict("t")) == (1, "FAIL")
    assert "[some_test] handled" in ran.details("t")


def test_a_test_that_fails_otherwise_is_in_error_with_the_reason_and_the_formula(run) -> None:
    ran = run(
        """
        @no_plan[test] +!a <- !nowhere(1).
        @action[test] +!b <- fly(3).
        @own_reason[test] +!c <- .fail(error_msg("too windy")).
        @context[test] +!d : windy <- !force_pass.
        @dropped[test] +!e <- .drop_intention(e).
        @stopped[test] +!f <- .stopMAS(0, 3).
        @relation[test] +!g <- X = 1;
            X > 3.
        """
    )
    assert ran.code == 1
    assert {line.split()[0] for line in ran.lines} == {"ERROR"}
    assert ran.details("no_plan")[1:] == [
        "at some_test.asl:2: @no_plan[test] +!a <- !nowhere(1).",
        "that is: nowhere(1)[source(self)]",
    ]
    assert (
        ran.details("action")[0] == "action_failed: there is no environment that could perform fly: name one by --env"
    )
    assert ran.details("own_reason")[0] == "internal_action: too windy"
    assert ran.details("context") == [
        "no_applicable: the context of the test plan does not hold",
        "no plan applied to +!d",
        "context[test] (some_test.asl:5): windy does not hold",
    ]
    assert ran.details("dropped")[0] == "dropped: the intention of the test was dropped before it ended"
    assert ran.details("stopped") == [".stopMAS ended the team with exit code 3"]
    assert ran.details("relation")[1:3] == ["at some_test.asl:9: X > 3.", "that is: (1 > 3)"]


def test_a_test_without_an_assertion_passes_with_a_warning(run) -> None:
    ran = run("@t[test] +!t <- true.")
    assert ran.code == 0
    assert ran.lines == ["ok      some_test.asl:1 t  (warning: passed without an assertion)"]
    assert "1 without an assertion" in ran.summary


def test_each_test_has_a_fresh_agent_with_the_beliefs_and_goals_of_its_file(run) -> None:
    ran = run(
        """
        count(0).
        !set_up.
        +!set_up <- +ready.
        +count(N) <- +seen(N).
        @one[test] +!t : ready & seen(0) <- -+count(7); !assert_true(count(7)).
        @two[test] +!t : ready & seen(0) <- !assert_true(count(0)).
        """
    )
    assert ran.code == 0, ran.out


def test_initial_goals_of_an_included_program_are_not_pursued_its_plans_and_beliefs_stay(run, tmp_path: Path) -> None:
    (tmp_path / "agent.asl").write_text("home(here). !begin. +!begin <- +begun. +!go(X) : home(X) <- +went.")
    ran = run('{ include("agent.asl") }\n@t[test] +!t <- !assert_false(begun); !go(here); !assert_true(went).')
    assert ran.code == 0, ran.out


def test_waiting_takes_no_time(run) -> None:
    begun = time.monotonic()
    ran = run(
        """
        @t[test] +!t <- .nano_time(A); .wait(1800000); .nano_time(B); !assert_equals(1800, (B - A) / 1000000000, 1).
        @u[test] +!u <- .at("now +5 m", {+!late}); .wait(late(_)); !force_pass.
        +!late <- +late(now).
        """
    )
    assert ran.code == 0, ran.out
    assert time.monotonic() - begun < 60


def test_a_test_that_waits_for_ever_ends_immediately_and_one_that_takes_too_long_at_its_limit(run) -> None:
    ran = run(
        """
        @waits[test] +!a <- .wait({+never}).
        @ticks[test] +!b <- !!tick; .wait(never).
        +!tick <- .wait(100); !tick.
        @long[test] +!c <- .wait(60000).
        @spins[test] +!d <- !spin.
        +!spin <- !spin.
        @computes[test] +!e : endless(0) <- true.
        endless(N) :- .range(I, 1, 1000000000) & I < 0.
        """,
        "--timeout",
        "0.5",
    )
    assert ran.code == 1
    assert [line.partition(": ")[2] for line in ran.lines] == [
        "it waits for something that can no longer happen",
        "not done after 0.5 s of its own time",
        "not done after 0.5 s of its own time",
        "not done after 0.5 s of real time",
        "not done after 0.5 s of real time",
    ]
    assert ran.details("waits")[1] == "at some_test.asl:2: @waits[test] +!a <- .wait({+never})."
    assert ran.summary.startswith("5 tests: 0 passed, 5 timed out")


HANGS = """
import time
from agentd import Environment

class Init(Environment):
    def init(self, arguments):
        time.sleep(1000)

class Swallows(Environment):
    def execute(self, agent, action):
        try:
            time.sleep(1000)
        except:
            time.sleep(1000)

class Stop(Environment):
    def execute(self, agent, action):
        return True

    def stop(self):
        time.sleep(1000)

class Never(Environment):
    def execute(self, agent, action):
        while True:
            try:
                time.sleep(0.05)
            except:
                pass
"""


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("Init", "the environment's init was not done after 0.3 s of real time"),
        ("Swallows", "not done after 0.3 s of real time"),
        ("Stop", "the environment's stop was not done after 0.3 s of real time"),
    ],
)
def test_the_limit_of_a_test_holds_for_its_environment(run, tmp_path: Path, name: str, expected: str) -> None:
    (tmp_path / "hangs.py").write_text(HANGS)
    ran = run("@t[test] +!t <- act; !force_pass.", "--timeout", "0.3", "--env", "hangs.py:" + name)
    assert (ran.code, [line.partition(": ")[2] for line in ran.lines]) == (1, [expected])


def test_an_environment_that_nothing_ends_ends_the_command(tmp_path: Path) -> None:
    (tmp_path / "hangs.py").write_text(HANGS)
    (tmp_path / "t.asl").write_text("@t[test] +!t <- act; !force_pass.")
    done = agentd("test", "t.asl", "--timeout", "0.3", "--env", "hangs.py:Never", cwd=tmp_path)
    assert done.returncode == 2
    assert re.fullmatch(r"agentd test: error: code \(.*hangs\.py:\d+\) ignores the end of its time; .*\n", done.stderr)


def test_other_agents_of_a_test_live_and_end_with_it(run, tmp_path: Path) -> None:
    (tmp_path / "echo.asl").write_text("+!say(X)[source(S)] <- .wait(1000); .print(X); .send(S, tell, said(X)).")
    ran = run(
        """
        @one[test] +!one
          <- .create_agent(echo, "echo.asl"); .send(echo, achieve, say(hi)); .wait({+said(X)});
             .all_names(L); .length(L, N); !assert_equals(2, N); .print(X).
        @two[test] +!two <- .all_names(L); !assert_equals([some_test], L).
        """,
        "-v",
    )
    assert ran.code == 0, ran.out
    assert "        [echo] hi\n        [some_test] hi\n" in ran.out


def test_what_runs_on_after_the_goal_of_a_test_may_still_fail_it(run) -> None:
    ran = run("@t[test] +!t <- !!later; !force_pass. +!later <- +x; +y; !assert_true(z).")
    assert (ran.code, ran.verdict("t")) == (1, "FAIL")


def test_a_program_keeps_the_assertions_that_it_brings(run) -> None:
    ran = run(
        """
        +!assert_equals(X, Y) <- .print("mine"); X = Y.
        @t[test] +!t <- !assert_equals(f(Z), f(1)).
        @u[test] +!u <- !assert_equals(1, 2).
        """,
        "-v",
    )
    assert ran.lines[0] == "ok      some_test.asl:3 t"
    assert ran.verdict("u") == "ERROR"
    assert "[some_test] mine" in ran.out


def test_a_program_that_catches_every_goal_gets_its_assertions_all_the_same(run) -> None:
    ran = run("@t[test] +!t <- !assert_true(false). +!G <- .print(caught, G).")
    assert ran.verdict("t") == "FAIL"


def test_assertions_work_within_a_namespace(run) -> None:
    ran = run("{ begin namespace(lab) } @t[test] +!t <- !assert_equals(1, 2). { end }")
    assert ran.lines[0].startswith("FAIL")
    assert ran.lines[0].endswith("expected 1, got 2")


def test_what_a_test_begins_goes_on_after_its_goal_for_ten_seconds_of_its_own_time(run) -> None:
    ran = run(
        """
        @t[test] +!t <- !!later(50); !force_pass.
        @u[test] +!u <- !!later(11000); !force_pass.
        @v[test] +!v <- !!again; !force_pass.
        +!later(T) <- .wait(T); !assert_true(false).
        +!again <- .wait(1000); !again.
        """
    )
    assert [ran.verdict(name) for name in "tuv"] == ["FAIL", "ok", "ok"]


@pytest.mark.parametrize("mapped", [False, True])
def test_programs_for_the_harness_of_jason_run_without_it(run, tmp_path: Path, mapped: bool) -> None:
    (tmp_path / "jason" / "test" / "inc").mkdir(parents=True)
    (tmp_path / "jason" / "test" / "inc" / "tester_agent.asl").write_text("!run_all. +!run_all <- .fail.")
    ran = run(
        '{ include("$jasonJar/test/inc/tester_agent.asl") }\n@t[test] +!t <- !assert_equals(1, 1).',
        *(["--map", "$jasonJar=jason"] if mapped else []),
    )
    assert (ran.code, ran.lines) == (0, ["ok      some_test.asl:2 t"])


FOR_JASON = """
{ include("tester_agent.asl") }
!execute_test_plans.
@[atomic,test] +!lists <- !assert_equals([a,b,b], [b,a]); !assert_equals([f(_)], [f(1)]); !assert_equals([], []).
@[test] +!no_lists <- !assert_equals(a, [a]).
@[test] +!other_members <- !assert_equals([a], [a,c]).
@[test] +!timed <- !check_performance(work, 3, Mean); !assert_greater_than(Mean, 0).
+!work <- .findall(X, .range(X, 1, 100), L).
"""


@pytest.mark.parametrize("there", [(), ("tester_agent.asl", "test_assert.asl", "test_manager.asl")])
def test_a_program_for_jasons_harness_includes_it_by_name_alone(run, tmp_path: Path, there: tuple[str, ...]) -> None:
    _make_harness(tmp_path / "inc", there)
    ran = run(FOR_JASON, "--include-path", "inc")
    assert ran.lines == [
        "ok      some_test.asl:4 lists",
        "FAIL    some_test.asl:5 no_lists: expected the members of a, got [a]: both must be lists",
        "FAIL    some_test.asl:6 other_members: expected the members of [a], got [a,c]",
        "ok      some_test.asl:7 timed",
    ]
    assert "no plan" not in ran.out


def test_a_file_that_is_only_named_as_one_of_the_harness_of_jason_is_included(run, tmp_path: Path) -> None:
    _make_harness(tmp_path / "inc", ("tester_agent.asl",))
    assert run(FOR_JASON, "--include-path", "inc").verdict("lists") == "ERROR"


def _make_harness(folder: Path, names: tuple[str, ...]) -> None:
    folder.mkdir()
    for name in names:
        (folder / name).write_text("+!assert_equals(_, _) <- .fail.")


def test_a_missing_included_file_is_reported_with_the_option_that_names_its_folder(run, tmp_path: Path) -> None:
    ran = run('{ include("tester_agent.asl") }\n{ include("bob.asl") }\n@t[test] +!t <- !force_pass.', name="t/t.asl")
    assert ran.code == 2
    assert "give its folder by --include-path FOLDER" in ran.err
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "bob.asl").write_text("b.")
    assert run(None, "t/t.asl", "--include-path", "lib").code == 0


def test_a_folder_is_searched_for_files_with_test_plans_and_each_plan_is_run_once(run) -> None:
    files = {
        "a/one.asl": "@t[test] +!t <- !force_pass.",
        "b/deep/two.asl": '{ include("../../a/one.asl") } @u[test] +!u <- !force_pass.',
        "b/agent.asl": "!work. +!work <- .fail.",
        "b/broken.asl": "+!work <- ; .",
        "b/notes.txt": "@t[test] +!t <- .fail.",
    }
    ran = run(None, ".", **files)
    assert ran.lines == ["ok      a/one.asl:1 t", "ok      b/deep/two.asl:1 u"]
    assert ran.code == 0


def test_files_that_are_links_in_a_loop_are_unreadable_and_the_others_run(run, tmp_path: Path) -> None:
    (tmp_path / "one.asl").symlink_to("two.asl")
    (tmp_path / "two.asl").symlink_to("one.asl")
    (tmp_path / "good.asl").write_text("@ok[test] +!ok <- !assert_true(true).")
    ran = run(None, str(tmp_path))
    assert ran.verdict("ok") == "ok"
    assert "one.asl: error: cannot read the program: it is no file, or a link to none" in ran.err


def test_a_folder_that_cannot_be_read_is_no_success(run, monkeypatch: pytest.MonkeyPatch) -> None:
    scandir = os.scandir

    def closed(path: str) -> object:
        if path == "./a":
            raise PermissionError(errno.EACCES, "Permission denied", path)
        return scandir(path)

    monkeypatch.setattr(os, "scandir", closed)
    ran = run(None, ".", **{"a/one.asl": "@t[test] +!t <- .fail.", "two.asl": "@u[test] +!u <- !force_pass."})
    assert (ran.code, ran.lines, ran.err) == (2, ["ok      two.asl:1 u"], "./a: error: Permission denied\n")


def test_a_folder_is_searched_for_marks_over_several_lines(run, tmp_path: Path) -> None:
    (tmp_path / "lines.asl").write_text("@one[atomic,\n  test] +!one <- .fail.\n@[x,\ntest]\n+!two <- !force_pass.")
    (tmp_path / "open.asl").write_text("// test " + "@[" * 100_000 + "\n+!work <- true.")
    ran = run(None, ".")
    assert [line.split()[:3] for line in ran.lines] == [["ERROR", "lines.asl:1", "one:"], ["ok", "lines.asl:3", "two"]]
    assert (ran.code, ran.err) == (1, "")


def test_a_folder_may_hold_programs_that_only_speak_of_tests(run, tmp_path: Path) -> None:
    (tmp_path / "agent.asl").write_text("// tests are marked so: @name[test]\n+!work <- true.")
    ran = run("@t[test] +!t <- !force_pass.", ".")
    assert (ran.code, ran.err) == (0, "")


def test_an_action_that_a_thread_settles_is_waited_for_in_real_time(run, tmp_path: Path) -> None:
    (tmp_path / "slow.py").write_text(
        "import threading\n"
        "from agentd import Deferred, Environment\n"
        "class Slow(Environment):\n"
        "    def execute(self, agent, action):\n"
        "        later = Deferred()\n"
        "        threading.Timer(0.05, later.succeed).start()\n"
        "        return later\n"
    )
    ran = run("@t[test] +!t <- act; !force_pass.", "--env", "slow.py:Slow")
    assert ran.code == 0, ran.out


def test_a_filter_chooses_by_a_part_of_the_name_or_a_pattern(run) -> None:
    program = "@walk[test] +!a <- !force_pass. @run_far[test] +!b <- !force_pass. @run_fast[test] +!c <- !force_pass."
    assert [line.split()[2] for line in run(program, "--filter", "run").lines] == ["run_far", "run_fast"]
    assert [line.split()[2] for line in run(program, "--filter", "*k").lines] == ["walk"]
    ran = run(program, "--filter", "swim")
    assert ran.code == 2
    assert "there is no test whose name fits swim in some_test.asl" in ran.err


def test_nothing_to_run_is_no_success(run, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    ran = run(None, "empty")
    assert (ran.code, ran.err) == (2, "agentd test: error: there is no test in empty\n")
    ran = run("+!t <- true.")
    assert ran.code == 2
    assert "some_test.asl: error: there is no test plan; mark one as @name[test] +!goal <- ..." in ran.err


def test_what_cannot_be_read_is_reported_and_the_rest_is_run(run, tmp_path: Path) -> None:
    (tmp_path / "good.asl").write_text("@t[test] +!t <- !force_pass.")
    ran = run("@t[test] +!t <- ; .", "good.asl", "gone.asl", name="bad.asl")
    assert ran.code == 2
    assert ran.lines == ["ok      good.asl:1 t"]
    assert "bad.asl:1:17: error:" in ran.err
    assert "gone.asl: error: cannot read the program: No such file or directory" in ran.err
    assert "1 test: 1 passed, 2 unreadable" in ran.summary


def test_a_mark_on_a_plan_that_is_for_no_goal_is_an_error(run) -> None:
    ran = run("@t[test] +b(X) <- true.")
    assert ran.code == 2
    assert "some_test.asl:1:1: error: a test is a plan for a goal, +!goal; this one is for +b(X)" in ran.err


def test_bad_options_are_errors(run) -> None:
    program = "@t[test] +!t <- !force_pass."
    for value in ("0", "-1", "nan", "inf", "soon"):
        with pytest.raises(SystemExit) as ended:
            run(program, "--timeout", value)
        assert ended.value.code == 2
    ran = run(program, "--env", "nowhere:World")
    assert ran.code == 2
    assert "there is no Python module nowhere" in ran.err
    ran = run(program, "--junit", "no/such/folder.xml")
    assert ran.code == 2
    assert "cannot write no/such/folder.xml: No such file or directory" in ran.err


def test_junit_xml_has_a_case_per_test_plan_and_reads_as_the_schema_of_junit_wants_it(run, tmp_path: Path) -> None:
    (tmp_path / "bad.asl").write_text("@t[test] +!t <- ; .")
    ran = run(
        """
        @good[test] +!a <- !force_pass.
        @differs[test] +!b <- .print("<&\x01>"); !assert_equals("<a>", "&").
        @breaks[test] +!c <- !nowhere.
        @waits[test] +!d <- .wait({+never}).
        """,
        "bad.asl",
        "--junit",
        "out.xml",
    )
    assert ran.code == 2
    root = ElementTree.parse(tmp_path / "out.xml").getroot()
    _valid(root)
    assert [(s.get("name"), s.get("tests"), s.get("failures"), s.get("errors")) for s in root] == [
        ("some_test.asl", "4", "2", "1"),
        ("bad.asl", "1", "0", "1"),
    ]
    good, differs, breaks, waits = root[0]
    assert len(good) == 0
    assert (good.get("classname"), good.get("file"), good.get("line")) == ("some_test", "some_test.asl", "2")
    failure, output = differs
    assert (failure.tag, failure.get("type"), failure.get("message")) == (
        "failure",
        "assertion",
        'expected "<a>", got "&"',
    )
    assert "some_test.asl:3" in str(failure.text)
    assert output.text == "[some_test] <&\N{REPLACEMENT CHARACTER}>"
    assert (breaks[0].tag, breaks[0].get("type")) == ("error", "error")
    assert (waits[0].tag, waits[0].get("type")) == ("failure", "timeout")


def _valid(root: ElementTree.Element) -> None:
    """The rules that the readers of JUnit XML share: which elements, in which order, with which attributes."""
    allowed = {
        "testsuites": {"name", "tests", "failures", "errors", "time"},
        "testsuite": {"name", "tests", "failures", "errors", "skipped", "time"},
        "testcase": {"name", "classname", "time", "file", "line"},
        "failure": {"message", "type"},
        "error": {"message", "type"},
        "system-out": set(),
    }
    inside = {"testsuites": ["testsuite"], "testsuite": ["testcase"], "testcase": ["error", "failure", "system-out"]}
    for element in root.iter():
        assert set(element.attrib) <= allowed[element.tag]
        for name in {"tests", "failures", "errors", "skipped"} & set(element.attrib):
            assert element.attrib[name].isdigit()
        if "time" in element.attrib:
            assert re.fullmatch(r"\d+\.\d{3}", element.attrib["time"])
        order = [inside.get(element.tag, []).index(child.tag) for child in element]
        assert order == sorted(order)
        if element.tag == "testsuite":
            cases = list(element)
            assert int(element.attrib["tests"]) == len(cases)
            assert int(element.attrib["failures"]) == sum(c.find("failure") is not None for c in cases)
            assert int(element.attrib["errors"]) == sum(c.find("error") is not None for c in cases)


def test_the_tests_of_the_first_mission_pass_with_a_vehicle_that_pretends() -> None:
    folder = "missions/single_uav"
    done = agentd("test", "--env", f"{folder}/vehicle.py:Vehicle", folder, cwd=REPOSITORY)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.count("ok ") == (REPOSITORY / folder / "uav_test.asl").read_text().count("[test]") > 0


def test_a_test_that_fails_as_no_plan_applied_to_an_event_says_why_each_did_not(run) -> None:
    ran = run(
        """
        @rescues[test] +!rescues <- +victim(1, 2); .wait(10); !assert_true(rescued).
        @flies[test] +!flies <- !go(1).
        @ok[test] +!ok <- +victim(1, 2); !assert_true(true).
        @nearby +victim(X, Y) : armed & X > 0 <- +rescued.
        +!go(X) : X > 5.
        """
    )
    assert ran.verdict("ok") == "ok"
    assert ran.details("rescues")[-2:] == [
        "no plan applied to +victim(1,2), raised at some_test.asl:2",
        "nearby (some_test.asl:5): armed does not hold",
    ]
    assert ran.details("flies")[-2:] == [
        "no plan applied to +!go(1), raised at some_test.asl:3",
        "+!go(X) (some_test.asl:6): 1 > 5 does not hold",
    ]
    assert ran.out.count("no plan applied") == 2
