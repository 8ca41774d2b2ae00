"""What `agentd check` tells about a program before it runs."""

import re
from pathlib import Path

import pytest

from agentd.check.external_knowledge import Arities
from agentd.language.compiler.compile import DirectiveError
from agentd.language.parse import parse_program
from agentd.mind.data.registry import missing_action
from agentd.runtime.program_paths import SourcePaths
from schemas.files.findings import Finding
from schemas.files.shipped_files import shipped
from tests.agentd.check.conftest import Check
from tests.agentd.check.findings import findings_about

ACTIONS: Arities = {"set_mode": 1, "takeoff": {1}, "land": 0, "goto": {2, 3}}
PERCEPTS: Arities = {"state": {3}, "altitude": 1}


MESSAGES = Path(__file__).parents[2] / "data" / "check" / "messages.txt"
"""Programs with one mistake each, and below each its findings: place, severity, kind and text."""


def findings_of(text: str) -> list[Finding]:
    return findings_about(text, ACTIONS, PERCEPTS)


def test_a_program_without_mistakes_has_no_findings() -> None:
    text = """
    target(1, 2). reachable(X) :- target(X, _).
    !fly.
    +!fly : state("GUIDED", true, _) & target(X, Y) <- takeoff(5); goto(X, Y); !report(math.max(X, 2)).
    -!fly[error(E)] <- .print("failed ", E); land.
    +!report(X) : not altitude(X) & reachable(_) <- +reported(X); ?reported(Z); .print(Z, " #{X}").
    +state(_, _, false) <- .wait(100).
    """
    assert findings_of(text) == []


def test_the_findings_of_each_mistake_read_as_written_down() -> None:
    shown = ""
    for program in re.findall(r"^\S.*(?:\n  \S.*)*", MESSAGES.read_text(encoding="utf-8"), re.MULTILINE):
        findings = findings_of(program)
        shown += f"{program}\n"
        shown += "".join(f"    {f.line}:{f.column} {f.severity} {f.kind}: {f.message}\n" for f in findings) + "\n"
    assert shown == MESSAGES.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "text",
    [
        "+!g : b(1)[source(boss)] <- land.",
        "+b(_)[source(_)]. +!g : b(1) <- land.",
        "+!g <- +b(1); ?b(_).",
        "+!g : b <- +{ b :- altitude(_) }.",
        "+!g : b <- -+b.",
        "+!g : b(_,_) <- for (altitude(X)) { +X }.",
        "+!g <- !h. -!h <- land.",
        "+!g <- !h. +!X <- !X.",
        "+!g <- .send(bob, achieve, h).",
        "+!g <- { +!h } = _; ?true; ?false.",
        "n::b. +!g : n::b <- land.",
        "{ begin namespace(n) } b. +!h : b <- land. { end } +!g : n::b <- !n::h.",
        "+!g : N::b(N) <- land.",
        '{ register_function("my.twice", 1, "twice") } +!g <- .print(my.twice(2)).',
        "+!g(X, X). +!g(_, _).",
        "+!g[source(a)]. +!g.",
        "@l +!g : altitude(_). +!g. -!g. +?g. +g. g.",
        "{ begin dg(done(_)) } +!done(X) <- land; .print(X). { end } !done(1).",
        "{ begin bc(done) } +!other <- land. { end } !done. !other.",
        "+!g <- { !nothing(X); +b(X) } = _; P = { +!h(Y) : not_there(Y) <- !nowhere(Y) }; .print(P).",
        "+!g : altitude(A) & not (altitude(B) & B > A) <- land.",
        "+!g <- .findall(X, altitude(X) & X > 3, L); .print(L).",
        "+!g <- .findall(X + 1, altitude(X), L); .print(L).",
        "+!g : altitude(A) & A > 3 & B = A + 1 <- if (B > 4) { land }; ?altitude(C); while (C > B) { land }.",
        "twice(X * 2) :- X = 3 | altitude(X). +!g : twice(_) <- land.",
        "+!g(A) : not A > 3 <- land. +!h : altitude(H) & (H > 3 | H < 1) <- land. +!k <- !g(K); land; .print(K + 1).",
        "+!g <- while (true) { .wait(10) }; while (altitude(A) & A > 1) { -+high(A) }.",
        "+!g <- .print(1); !g. -!g.",
        "!g. +!g : altitude(_) <- land. +!kqml_received(A, B, C, D) <- .print(A, B, C, D).",
        "@t[test] +!this_works <- !assert_true(altitude(_)).",
        "+jag_shutting_down(T) <- .print(T).",
        "+!g(X) <- .print(X). { +!h : altitude(_) <- .print(1). +!h <- .print(2). } +!k <- !h.",
    ],
)
def test_what_is_fine_is_not_told(text: str) -> None:
    assert findings_of(text) == []


def test_without_a_manifest_actions_and_percepts_are_taken_as_known_and_misspelt_beliefs_are_reported() -> None:
    assert findings_about("+!g : altitude(A) & A > 1 <- fly(A).") == []
    (finding,) = findings_about("waypoint(1). +!g : waypont(A) <- fly(A).")
    assert finding.message.endswith("did you mean `waypoint`?")


def test_beliefs_of_the_mission_count_as_added() -> None:
    program = parse_program("+!g : rescuers(_) <- land.", "a.asl")
    assert findings_about(program, ACTIONS, PERCEPTS, beliefs=[("rescuers", 1)]) == []


def test_all_findings_come_in_one_run_in_the_order_of_the_file() -> None:
    text = """!go.
+!g : state(_,_,_,_)
   <- take_off(5);
      .pnt("x");
      !h(X).
"""
    assert [str(finding) for finding in findings_of(text)] == [
        "a.asl:1:2: error: there is no plan for the goal !go/0",
        "a.asl:2:7: warning: the percept state has 3 arguments, not 4: state(_,_,_,_) is always false",
        "a.asl:3:7: error: there is no action take_off/1, did you mean `takeoff`?",
        "a.asl:4:7: error: there is no internal action .pnt/1: it fails the plan that reaches it, "
        "did you mean `.print`?",
        "a.asl:5:8: error: there is no plan for the goal !h/1",
        "a.asl:5:10: warning: the variable X occurs only once; is it misspelt? if not, write _ or _X",
    ]


def test_included_files_are_checked_with_the_program(check: Check) -> None:
    main = '{ include("parts/common.asl") } { include("parts/common.asl", n) }\n'
    main += "!help. !n::help. !more. !n::more. !lost.\n"
    common = '{ include("more.asl") }\n+!help <- .prnt(1).\n'
    more = '+!more <- .print(1).\n{ include("common.asl") }\n'
    told = check({"main.asl": main, "parts/common.asl": common, "parts/more.asl": more})
    assert [line.split(";")[0] for line in told.err.splitlines()] == [
        "main.asl:2:36: error: there is no plan for the goal !lost/0",
        "parts/common.asl:2:11: error: there is no internal action .prnt/1: it fails the plan that reaches it, "
        "did you mean `.print`?",
        'parts/more.asl:2:1: error: cannot include "common.asl": files include one another without end',
    ]


@pytest.mark.parametrize("way", ["main.asl", "more.asl"])
def test_files_that_include_one_another_without_end_are_reported_as_by_the_run(way: str, check: Check) -> None:
    told = check({"main.asl": f'{{ include("{way}") }}\n!s. +!s.\n', "more.asl": '{ include("main.asl") }\n'})
    assert told.err == f'{way}:1:1: error: cannot include "main.asl": files include one another without end\n'
    assert told.code == 1
    with pytest.raises(DirectiveError, match="files include one another without end"):
        SourcePaths().compiled("main.asl")


RUNS_ON_JASON = {
    "an ask that is answered": "!s. +!s <- .send(bob, askOne, t(_), A); .print(A).",
    "an ask in an atomic plan": "!s. @a[atomic] +!s <- .send(bob, askOne, t(_), A); .print(A).",
    "a loop that another intention ends": "!s. !t. +!s <- .print(1); !s. +!t <- .wait(9); .drop_intention(s).",
    "a loop that ends with its team": "!s. !t. +!s <- while (true) { +a(1) }. +!t <- .wait(9); .stopMAS.",
    "a loop that a plan for all goals takes": "!s. +!G : G = s & n(3) <- .print(G). +!s <- .print(1); !s. n(3).",
    "beliefs of an environment": "+temp(T) : wind(W) & not calm <- .print(T, W). -temp(_) <- ?pressure(P); .print(P).",
    "a percept that is named as a belief": "pos(1). !s. +!s : pos(X,Y) <- .print(X, Y). +pos(X,Y,Z) <- .print(X,Y,Z).",
    "a percept that is named as a belief of a namespace": "lab::t(1). !s. +!s : not t(_) <- ?lab::t(X); .print(X).",
    "a percept that is named nearly as an event of agentd": "!s. +!s : state(M) <- .print(M).",
    "plans that are only looked at": "!s. @p +!g(_). @q +!g(1). +!s <- .relevant_plans({+!g(_)}, L); .print(L).",
    "its own namespace": "!s. v(1). +!s <- ?this_ns::v(X); !this_ns::t(X). +!t(X) <- .print(X).",
    "any namespace": "!s. +!s <- !bar::open; +bar::known; -bar::known. +!N::open <- .print(N). +N::known <- .print(N).",
    "a file that is included twice": '{ include("more.asl") } { include("more.asl") } { include("both.asl") } !h.',
    "a test for the harness of Jason": '{ include("tester_agent.asl") } @[test] +!t <- !assert_equals([1], [1]).',
}


@pytest.mark.parametrize("program", RUNS_ON_JASON)
def test_a_program_that_runs_on_jason_has_no_findings(program: str, check: Check) -> None:
    more = "@p +!g(X) : X > 1 <- .print(X). @q +!g(X) <- .print(X). v(1)."
    both = '{ include("more.asl") } +!h <- !g(1).'
    told = check({"main.asl": RUNS_ON_JASON[program], "more.asl": more, "both.asl": both})
    assert (told.code, told.err) == (0, "")


@pytest.mark.parametrize("way", [".send(bob, askHow, {+!fold(_)})", '.send(self, tellHow, "+!fold(_).")'])
def test_a_goal_whose_plan_may_be_learnt_is_no_error(way: str, check: Check) -> None:
    told = check(f"!s. +!s <- {way}; .wait(100); !fold(1).")
    assert told.code == 0
    assert "!fold/1; it fails unless a plan for it is added in time" in told.err


def test_a_name_that_exists_with_other_arguments_is_not_taken_for_misspelt() -> None:
    text = "!s. +!s <- .wait; !go(1); .print(a). +!go(X, Y) <- .print(X, Y)."
    told = [one.message for one in findings_about(text)]
    assert told == [
        ".wait takes 1, 2 or 3 arguments, not 0",
        "there is no plan for the goal !go/1; there are plans for go with 2 arguments",
    ]
    assert missing_action(".wait", 0) == "there is no internal action .wait/0"


def test_an_include_of_a_missing_or_wrong_file_is_an_error(check: Check) -> None:
    main = '{ include("missing.asl") }\n{ include("wrong.asl") }\n{ include }\n{ include("\0") }\n'
    told = check({"main.asl": main, "wrong.asl": "+!g <- a b.\n"})
    assert [line.partition(": error: ")[0] for line in told.err.splitlines() if ": error: " in line] == [
        "main.asl:1:1",
        "main.asl:3:1",
        "main.asl:4:1",
        "wrong.asl:1:10",
    ]
    assert told.err.startswith('main.asl:1:1: error: cannot include "missing.asl": No such file')


def test_the_depth_of_a_program_is_no_problem() -> None:
    deep = 10_000
    for text in (
        "+!g : " + "not (" * deep + "altitude(_)" + ")" * deep + ".",
        "+!g <- " + "if (altitude(_)) {" * 90 + "land" + "}" * 90 + ".",
        "b(" + "[" * deep + "]" * deep + ").",
        "+!g : altitude(_)" + " & altitude(_)" * deep + ".",
        "+!g. " + "{ +!g. " * 90 + "}" * 90,
    ):
        assert findings_of(text) == [], text[:20]


def test_the_standard_library_is_known() -> None:
    text = """!g.
+!g : .length("ab", 2) & .count(n(_)) > 0
   <- .print(math.max(1, 2), system.time); .foreach(n(_), { .wait(10) }); .if_then_else(n(_), { .done }, { .fail }).
n(1)."""
    assert findings_about(text) == []
    (finding,) = findings_about("+!g <- .lenght([], 0).")
    assert finding.message.endswith("did you mean `.length`?")


# --- the command -----------------------------------------------------------------------------------------------------


def test_the_command_ends_with_0_when_there_are_only_warnings(check: Check) -> None:
    told = check("!go.\n+!go : X > 1.\n")
    assert (told.code, told.out) == (0, "")
    assert told.err.startswith("a.asl:2:8: warning: the variable X")


def test_the_command_ends_with_2_when_a_file_cannot_be_read_and_tells_the_errors_of_the_others(check: Check) -> None:
    Path("c.asl").write_bytes(b"\xff")
    told = check({"a.asl": "!go.\n", "b.asl": "+!g <- a b.\n"}, "a.asl", "b.asl", "c.asl", "d.asl")
    assert told.code == 2
    assert "a.asl:1:2: error: there is no plan for the goal !go/0\n" in told.err
    assert "b.asl:1:10: error: a ; is missing before 'b'\n    +!g <- a b.\n             ^\n" in told.err
    assert "c.asl:1: error: byte 0 of the file (0xff) is not UTF-8" in told.err
    assert "d.asl: error: cannot be read: No such file or directory" in told.err


def test_what_the_checked_files_send_to_one_another_is_known(check: Check) -> None:
    a = "!go. +!go <- .send(b, tell, color(red)); .send(b, achieve, paint(1)).\n"
    b = "!begin. +!begin <- .print(b). +!paint(_) : color(_) <- .print(yes). +!print(_) : colour(_) <- .print(no).\n"
    told = check({"a.asl": a, "b.asl": b}, "a.asl", "b.asl")
    assert [line.split("warning: ")[1] for line in told.err.splitlines()] == [
        "this plan is never used unless others send its event: nothing sets the goal !print/1, did you mean `paint`?",
        "nothing adds the belief colour/1: colour(_) is always false unless it is a percept or an agent sends it, "
        "did you mean `color`?",
    ]
    assert told.code == 0


def test_a_project_is_checked_with_its_agents(check: Check) -> None:
    project = 'MAS t { agents: ann [beliefs="size(1)", goals="begin(2)"]; bob; eve; aslSourcePath: "src"; }\n'
    ann = "+!begin(X) : size(Y) & X > Y <- .prnt(X).\n"
    told = check({"team.mas2j": project, "src/ann.asl": ann, "src/bob.asl": "+!g <- a b.\n"})
    assert told.code == 1
    assert "team.mas2j:1:65: error: cannot read eve.asl, the program of the agent eve" in told.err
    assert "ann.asl:1:33: error: there is no internal action .prnt/1" in told.err
    assert "bob.asl:1:10: error: a ; is missing before 'b'" in told.err
    assert "size" not in told.err
    assert "begin" not in told.err


def test_the_command_prints_json(check: Check) -> None:
    told = check("!go.\n", "--json")
    assert told.code == 1
    assert told.findings == [
        {
            "file": "a.asl",
            "line": 1,
            "column": 2,
            "severity": "error",
            "kind": "goal-without-plan",
            "message": "there is no plan for the goal !go/0",
        }
    ]


def test_the_command_checks_against_a_shipped_manifest(check: Check) -> None:
    program = "+!g : state(_,_,_,_) & bridge(up) <- take_off(5).\n"
    told = check(program, "--manifest", "copter")
    assert told.code == 1
    assert "the percept state has 3 arguments, not 4" in told.err
    assert "did you mean `takeoff`?" in told.err
    assert "bridge" not in told.err
    told = check(program, "--manifest", "no_such_robot")
    assert told.code == 2
    assert "no_such_robot" in told.err


def test_arguments_that_go_as_texts_may_be_variables_and_only_numbers_have_ranges(check: Check) -> None:
    manifest = shipped("manifests", "copter.toml")
    text = manifest.read_text().replace('driver = "mavlink"', 'driver = "mavlink"\nvalues = "text"', 1)
    program = '!g.\n+!g <- arm_motors(True); takeoff("5"); takeoff(500); .print(Alone).\n'
    told = check({"a.asl": program, "text.toml": text}, "--manifest", "text.toml")
    assert told.code == 1
    assert "True" not in told.err
    assert '"5"' not in told.err
    assert "takeoff takes altitude: float 1..120 m, not 500" in told.err
    assert "the variable Alone occurs only once" in told.err
    told = check(program, "--manifest", "copter")
    assert told.code == 1
    assert "the variable True occurs only once" in told.err
    assert 'takeoff takes altitude: float 1..120 m, not "5"' in told.err


def test_a_list_may_be_the_argument_of_an_action_that_takes_lists_and_of_no_other(check: Check) -> None:
    upload = '!g.\n+!g <- upload_mission([["takeoff", 0, 0, 10], [-27.6, -48.5, 20], ["rtl"]]).\n'
    assert check(upload, "--manifest", "copter").code == 0
    told = check("!g.\n+!g <- takeoff([5]).\n", "--manifest", "copter")
    assert told.code == 1
    assert "takeoff takes altitude: float 1..120 m, not [5]" in told.err


PEN = """
[robot]
driver = "zenoh"
[actions.pen]
service = "pen"
params = [{name = "r", type = "int"}, {name = "g", type = "int"}, {name = "width", max = 9, default = 3}]
"""


def test_arguments_with_a_default_may_be_left_out_and_are_checked_where_they_stand(check: Check) -> None:
    program = "+!g <- pen(1, 2); pen(1, 2, 5).\n+!h <- pen(1, 2, 10); pen(x).\n"
    told = check({"a.asl": program, "pen.toml": PEN}, "--manifest", "pen.toml")
    assert [line.partition(": error: ")[2] for line in told.err.splitlines()] == [
        "the action pen takes width: float ..9 = 3, not 10",
        "the action pen takes 2 or 3 arguments, not 1",
    ]
