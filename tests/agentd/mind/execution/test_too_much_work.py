"""A formula that would compute for ever fails, in whatever way it is written, and the mind goes on."""

import pytest

from agentd.mind import mind
from agentd.mind.beliefs import work_limit
from agentd.mind.execution import cycle, execution, waiting
from tests.agentd.minds import run

MANY = " ".join(f"q({n})." for n in range(40))


@pytest.fixture
def short_of_breath(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give formulas a hundredth of their steps: what is without end takes a hundredth of the time."""
    for module in (cycle, execution, mind, waiting, work_limit):
        monkeypatch.setattr(module, "MOST_STEPS", work_limit.MOST_STEPS // 100)


@pytest.mark.usefixtures("short_of_breath")
@pytest.mark.parametrize(
    "formula",
    [
        ".findall(X, .range(X,1,1e11) & X < 0, L)",
        ".count(q(A) & q(B) & q(C) & q(D) & q(E) & A < 0, N)",
        "?(r(X) & r(Y) & X < 0)",
        "?fib(26, F)",
        ".range(L,1,1); Q = (r(X) & r(Y) & X < 0); .findall(X, Q, S)",
        "for (.range(X,1,1e11)) { +b(X) }",
        ".wait(r(X) & r(Y) & X < 0)",
        "?not (r(X) & r(Y) & X < 0)",
        ".findall(A, q(A)[source(S)] & q(B)[source(S)] & q(C)[source(S)] & q(D)[source(S)] & A < 0, L)",
    ],
)
def test_a_formula_without_end_fails_its_plan_with_too_much_work(formula: str) -> None:
    world = run(
        f"{MANY} r(X) :- .range(X,1,100000). fib(0,0). fib(1,1). "
        "fib(N,F) :- N > 1 & fib(N-1,A) & fib(N-2,B) & F = A+B. "
        f"!s. +!s <- {formula}; .print(no). -!s[error(E)] <- .print(E). !t. +!t <- .print(t)."
    )
    assert sorted(world.prints) == ["t", "too_much_work"]


def test_a_formula_has_two_million_steps(request: pytest.FixtureRequest) -> None:
    assert work_limit.MOST_STEPS == 2_000_000
    request.getfixturevalue("short_of_breath")
    program = "!s. +!s <- .count(.range(X,1,LAST), C); .print(C). -!s[error(E)] <- .print(E)."
    assert run(program.replace("LAST", "19900")).prints == ["19900"]
    assert run(program.replace("LAST", "20100")).prints == ["too_much_work"]


@pytest.mark.usefixtures("short_of_breath")
def test_a_context_without_end_leaves_the_event_to_the_next_plan_and_is_reported() -> None:
    world = run("r(X) :- .range(X,1,1e11). !s. +!s : r(X) & X < 0 <- .print(no). +!s <- .print(second).")
    assert world.prints == ["second"]
    assert "steps" in world.logs[0]


@pytest.mark.usefixtures("short_of_breath")
def test_much_work_in_many_steps_is_no_harm() -> None:
    program = "!s(10). +!s(0) <- .print(done). +!s(N) <- .count(.range(X,1,10000), C); !s(N-1)."
    assert run(program).prints == ["done"]
