"""Depth and length: recursion of goals, long lists, deep terms, constant memory for tail calls."""

from __future__ import annotations

import pytest

from tests.agentd.minds import World, mind_of, run


def test_a_hundred_thousand_levels_of_goals_return_their_results() -> None:
    world = run("!s. +!s <- !sum(100000,S); .print(S). +!sum(0,0). +!sum(N,S) <- !sum(N-1,T); S = N+T.")
    assert world.prints == ["5000050000"]


def test_a_failure_a_hundred_thousand_levels_deep_finds_its_handler() -> None:
    world = run(
        '!s. +!s <- !down(100000). +!down(0) <- .fail. +!down(N) <- !down(N-1); .print(no). -!s <- .print("ok").'
    )
    assert world.prints == ["ok"]


def test_tail_calls_keep_the_stack_flat() -> None:
    mind = mind_of("!count(0). +!count(N) : N < 20000 <- !count(N+1). +!count(N) <- .wait(1000).")
    World(mind).settle()
    (intention,) = mind.all_intentions()
    assert len(intention.stack) == 1


def test_tail_calls_with_results_leave_no_trail_behind() -> None:
    program = "!loop(0). +!loop(N) : N < 5000 <- !get(N,X); !loop(X). +!get(N,N+1). +!loop(N) <- .wait(1000)."
    mind = mind_of(program)
    World(mind).settle()
    (intention,) = mind.all_intentions()
    assert len(intention.stack) == 1
    assert len(intention.trail) < 10


def test_an_endless_loop_in_one_plan_leaves_no_trail_behind() -> None:
    mind = mind_of("n(0). !go. +!go <- while (n(N) & N < 3000) { !get(N,X); -+n(X) }; .wait(1000). +!get(N,N+1).")
    World(mind).settle()
    (intention,) = mind.all_intentions()
    assert len(intention.trail) < 10


def test_lists_of_a_hundred_thousand_elements_are_built_sorted_printed_and_believed() -> None:
    program = """
        !s.
        +!s <- !build(100000,[],L); .length(L,N); .print(N); .sort(L,S); .nth(0,S,A); .nth(99999,S,Z); .print(A," ",Z);
               +kept(L); ?kept(K); if (K == L) { .print("same") }; .concat(L,[x],C); .length(C,M); .print(M);
               .reverse(L,R); R = [H|_]; .print(H).
        +!build(0,L,L).
        +!build(N,Acc,L) <- !build(N-1,[N|Acc],L).
    """
    assert run(program).prints == ["100000", "1 100000", "same", "100001", "100000"]


def test_terms_nested_ten_thousand_deep_are_compared_believed_and_found() -> None:
    program = """
        !s.
        +!s <- !nest(10000,z,T); !nest(10000,z,U); if (T == U) { .print("equal") }; if (T = U) { .print("unify") };
               +kept(T); if (kept(U)) { .print("found") }; -kept(U); if (not kept(_)) { .print("gone") }.
        +!nest(0,T,T).
        +!nest(N,A,T) <- !nest(N-1,f(A),T).
    """
    assert run(program).prints == ["equal", "unify", "found", "gone"]


def test_a_rule_that_calls_itself_without_end_fails_the_plan() -> None:
    world = run('loop(X) :- loop(X). !s. +!s <- ?loop(1). -!s[error(E)] <- .print("failed").')
    assert world.prints == ["failed"]


@pytest.mark.parametrize("size", [500])
def test_a_rule_may_call_itself_some_hundred_levels_deep(size: int) -> None:
    world = run(f"len(0,0). len(N,M) :- N > 0 & len(N-1,K) & M = K+1. !s. +!s <- ?len({size},M); .print(M).")
    assert world.prints == [str(size)]


def test_a_context_of_fifty_literals_compiles() -> None:
    facts = " ".join(f"p{n}({n})." for n in range(50))
    context = " & ".join(f"p{n}(X{n})" for n in range(50))
    assert run(f"{facts} !s. +!s : {context} <- .print(X0, X49).").prints == ["049"]


def test_a_cyclic_term_fails_the_plan_that_stores_it_and_hangs_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (
        "agentd.language.terms",
        "agentd.language.term_text",
        "agentd.mind.unifier",
        "agentd.mind.resolving",
    ):
        monkeypatch.setattr(f"{module}.MOST_NODES", 10_000)
    world = run("!s. +!s <- X = f(X); .print(cyclic); +b(X). -!s <- .print(handled).")
    assert world.prints == ["cyclic", "handled"]


def test_an_initial_belief_or_goal_that_is_nested_too_deep_is_left_out_and_told() -> None:
    deep = "f(" * 100_000 + "1" + ")" * 100_000
    world = run(f"b({deep}). b(1).\n!g({deep}). !h. +!h : b(X) <- .print(X).")
    assert world.prints == ["1"]
    assert [text[:60] for text in world.logs] == [
        "test.asl:1:1: b/1 is nested too deep; it is left out",
        "test.asl:2:1: g/1 is nested too deep; it is left out",
    ]
