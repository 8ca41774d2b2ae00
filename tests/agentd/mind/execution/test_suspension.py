"""``.suspend`` and ``.resume`` of intentions that wait, ask, fork, fail or are atomic: none is lost or runs early."""

from tests.agentd.teams import played

AMY = "v(7). +?slow(X) <- .wait(60); X = 1."
BOB = """
!start.
+!ask <- .send(amy, askOne, slow(_), A); .print("answer ", A).
+!limited <- .send(amy, askOne, slow(_), A, 20); .print("limit ", A).
+!event <- .wait({ +go(X) }); .print("event ", X).
+!formula <- .wait(ready(X)); .print("formula ", X).
+!fails <- .wait(never, 30); .print("not here").
-!fails[error(E)] <- .print("failed with ", E); .wait(10); .print("handled").
+!outer <- !inner; .print("outer ends").
+!inner <- .print("inner begins"); .wait(10); .print("inner ends").
+!forks <- { .wait(30); .print("first branch") } |&| { .wait(50); .print("second branch") }; .print("joined").
"""


def lines(body: str) -> list[str]:
    team = {"bob": f"{BOB}+!start <- {body}; .findall(I, .intention(I, _), L); .print(L).", "amy": AMY}
    return [line.removeprefix("[bob] ") for line in played(team)]


def test_an_answer_or_time_limit_that_comes_meanwhile_is_there_after_resuming() -> None:
    assert lines(
        "!!ask; !!limited; .wait(5); .suspend(ask); .suspend(limited); .wait(200); .print(resume);"
        ".resume(ask); .resume(limited); .wait(10)"
    ) == ["resume", "answer slow(1)[source(amy)]", "limit timeout", "[1]"]


def test_an_event_or_formula_that_comes_meanwhile_counts() -> None:
    assert lines(
        "!!event; !!formula; .wait(5); .suspend(event); .suspend(formula); +go(1); +ready(2); -go(1); -ready(2);"
        ".wait(50); .print(resume); .resume(event); .resume(formula); .wait(10)"
    ) == ["resume", "event 1", "formula 2", "[1]"]


def test_a_goal_that_fails_while_it_is_suspended_is_handled_after_resuming() -> None:
    assert lines(
        "!!fails; .wait(5); .suspend(fails); .wait(100); .suspended(fails, R); .print(R); .resume(fails); .wait(50)"
    ) == ["suspend_ia", "failed with wait_timeout", "handled", "[1]"]


def test_a_goal_is_found_while_its_failure_plan_runs() -> None:
    assert lines(
        "!!fails; .wait(35); if (.intend(fails)) { .print(intended) }; .suspend(fails); .wait(50);"
        ".resume(fails); .wait(10)"
    ) == ["failed with wait_timeout", "intended", "handled", "[1]"]


def test_a_sub_goal_and_branches_are_suspended_with_their_intention() -> None:
    assert lines(
        "!!outer; !!forks; .wait(5); .suspend(inner); .suspend(forks); .wait(200); .print(resume);"
        ".resume(outer); .resume(forks); .wait(10)"
    ) == ["inner begins", "resume", "inner ends", "outer ends", "first branch", "second branch", "joined", "[1]"]


def test_a_goal_whose_event_still_waits_is_suspended_and_resumed() -> None:
    assert played(
        {"bob": "@a[atomic] +!start <- !!later; .suspend(later); .resume(later). +!later <- .print(later). !start."}
    ) == ["[bob] later"]


def test_an_atomic_plan_that_suspends_itself_lets_the_others_run_until_it_is_resumed() -> None:
    assert played(
        {
            "bob": """
            !start. !other.
            @a[atomic] +!start <- .print(1); .suspend; .print(3); .wait(20); .print(4).
            +!other <- .print(2); .resume(start); !after.
            +!after <- .print(5).
            """
        }
    ) == [f"[bob] {number}" for number in (1, 2, 3, 4, 5)]


def test_why_an_intention_does_not_run_is_reported() -> None:
    assert lines(
        "!!ask; !!event; !!formula; !!outer; !!forks; .wait(5); "
        'for (.member(G, [ask,event,formula,outer,forks])) { .suspended(G, R); .print(G, " ", R) };'
        ".drop_all_intentions"
    ) == [
        "inner begins",
        "ask waiting_ask",
        "event wait({ +go(X) })",
        "formula wait(ready(X))",
        "outer wait(10)",
        "forks fork",
        "[1]",
    ]
