"""Depth and length: recursion of goals, long lists, deep terms, constant memory for tail calls."""

import pytest

from tests.agentd.minds import World, mind_of, run
from tests.support.amount import some_of

DEPTH = some_of(10_000)
"""Of nested sources and terms: beyond what the interpreter recurses, 1,000."""
TOO_DEEP = 10_000
"""Beyond what commands let it recurse."""
FACTS = " ".join(f"p{n}({n})." for n in range(50))
CONTEXT = " & ".join(f"p{n}(X{n})" for n in range(50))
PATTERN = ",".join(f"X{n}" for n in range(100))
DOUBLES = "+!d(X,N,R) : N > 0 <- !d(f(X,X),N-1,R). +!d(X,0,X)."
TWICE = "+!t(N,S,R) : N > 0 <- .concat(S,S,T); !t(N-1,T,R). +!t(0,S,S). -!s[error(E)] <- .print(E)."
LARGE = {
    "a hundred thousand levels of goals return their results": (
        "!s. +!s <- !sum(100000,S); .print(S). +!sum(0,0). +!sum(N,S) <- !sum(N-1,T); S = N+T.",
        "5000050000",
    ),
    "a failure a hundred thousand levels deep finds its handler": (
        "!s. +!s <- !down(100000). +!down(0) <- .fail. +!down(N) <- !down(N-1); .print(no). -!s <- .print(ok).",
        "ok",
    ),
    "a rule that calls itself without end fails the plan": (
        "loop(X) :- loop(X). !s. +!s <- ?loop(1). -!s[error(E)] <- .print(failed).",
        "failed",
    ),
    "a rule may call itself five hundred levels deep": (
        "len(0,0). len(N,M) :- N > 0 & len(N-1,K) & M = K+1. !s. +!s <- ?len(500,M); .print(M).",
        "500",
    ),
    "a term of a million million million parts is built and believed, and its twin takes too much": (
        f"""!s. +!s <- !d(x,60,X); !d(x,60,Y); +big(X); .print(ok); !m(Y). {DOUBLES}
        +!m(Y) <- ?big(Y). -!m(_)[error(E)] <- .print(E).""",
        "ok",
        "recursion_too_deep",
    ),
    "terms of so many parts are not compared": (
        f"!s. +!s <- !d(x,60,X); !d(x,60,Y); if (X < Y) {{ .print(less) }}. -!s[error(E)] <- .print(E). {DOUBLES}",
        "recursion_too_deep",
    ),
    "a sum of so many terms is computed": (
        "!s. +!s <- !d(Z,60,Y); Z = 1; W = Y+1; .print(W). +!d(X,N,R) : N > 0 <- !d(X+X,N-1,R). +!d(X,0,X).",
        "1152921504606846976",
    ),
    "a pattern that would be searched for ever fails": (
        f"""!s. +!s <- .replace("{"a" * 50}b", "(a+)+$", "", R). -!s[error(E)] <- .print(E).""",
        "too_much_work",
    ),
    "terms that take long to compare are not put in order": (
        """!s. +!s <- .findall(X, .range(X,1,50000), A); .findall(X, .range(X,1,50000), B);
            .findall(f(B,N), .range(N,1,300), L); .findall(f(A,N), .range(N,1,300), K); .concat(K,L,M); .sort(M,_).
        -!s[error(E)] <- .print(E).""",
        "too_much_work",
    ),
    "a plan is not read from a text that takes long to parse": (
        f"""!s. +!s <- !t(17,"a; ",B); .concat("+!x <- ",B,"a",P); .add_plan(P). {TWICE}""",
        "too_much_work",
    ),
    "a term is not read from a text that takes long to parse": (
        f"""!s. +!s <- !t(17,"a, ",B); .concat("[",B,"a]",T); .term2string(_,T). {TWICE}""",
        "too_much_work",
    ),
    "a trigger is not read from a text that takes long to parse": (
        f"""!s. +!s <- !t(17,"a, ",B); .concat("+!x(",B,"a)",T); .relevant_plans(T,_). {TWICE}""",
        "too_much_work",
    ),
    "a text that grows without end by replacing fails": (
        f"""!s("a"). +!s(S) <- .replace("{"a" * 50}", "a", S, T); !s(T). -!s(_)[error(E)] <- .print(E).""",
        "too_large",
    ),
    "a format of many wide places fails": (
        f"""!s. +!s <- !t(11, "%10000s", F); .printf(F, {", ".join(["1"] * 2048)}). {TWICE}""",
        "too_large",
    ),
    "a list of long texts in a format fails": (
        f"""!s. +!s <- !t(17, "{"a" * 100}", S); .printf("%s", [S,S]). {TWICE}""",
        "too_large",
    ),
    "a text with many long variables in it fails": (
        f"""!s. +!s <- !t(17, "{"a" * 100}", S); .puts("#{{S}}#{{S}}", R). {TWICE}""",
        "too_large",
    ),
    "a line of long texts fails": (f"""!s. +!s <- !t(17, "{"a" * 100}", S); .print(S, S). {TWICE}""", "too_large"),
    "the text of a term that holds a long text many times fails": (
        f"""!s. +!s <- !t(17, "{"a" * 100}", S); .term2string(f(S,S), R). {TWICE}""",
        "too_large",
    ),
    "the text of code that holds a long text many times fails": (
        f"""!s. +!s <- !t(17, "{"a" * 100}", S); .print({{ +!g <- a(S); b(S) }}). {TWICE}""",
        "too_large",
    ),
    "a queue that is added to itself fails": (
        f"""!s. +!s <- .queue.create(Q); .queue.add(Q, a); !q(Q). +!q(Q) <- .queue.add_all(Q, Q); !q(Q). {TWICE}""",
        "too_large",
    ),
    "a context of fifty literals compiles": (f"{FACTS} !s. +!s : {CONTEXT} <- .print(X0, X49).", "049"),
    "a pattern with a hundred elements fits": (
        f"!s. +!s <- .findall(I, .range(I,0,99), L); !g(L). +!g([{PATTERN}]) <- .print(X0, X99).",
        "099",
    ),
}


@pytest.mark.parametrize("size", LARGE)
def test_what_is_large_works_or_fails_in_its_plan(size: str) -> None:
    program, *printed = LARGE[size]
    assert run(program).prints == printed


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


def test_terms_nested_deep_are_compared_believed_and_found() -> None:
    program = f"""
        !s.
        +!s <- !nest({DEPTH},z,T); !nest({DEPTH},z,U);
               if (T == U) {{ .print("equal") }}; if (T = U) {{ .print("unify") }};
               +kept(T); if (kept(U)) {{ .print("found") }}; -kept(U); if (not kept(_)) {{ .print("gone") }}.
        +!nest(0,T,T).
        +!nest(N,A,T) <- !nest(N-1,f(A),T).
    """
    assert run(program).prints == ["equal", "unify", "found", "gone"]


@pytest.mark.parametrize("term", ["f(X)", "[1|X]", "[a,f(b)|X]", "f([1|X],2)"])
@pytest.mark.parametrize("use", ["+b(X)", ".print(X)", ".send(me,tell,b(X))", "!other(X)", ".length(X,N); .sort(X,S)"])
def test_a_cyclic_term_of_any_kind_is_found_out_soon(term: str, use: str) -> None:
    world = run(f"!s. +!s <- X = {term}; {use}; .fail. +!other(Y) <- +b(Y). -!s <- .print(handled).")
    assert world.prints[-1] == "handled"


def _nested(inner: str, before: str = "f(", after: str = ")", depth: int = DEPTH) -> str:
    return before * depth + inner + after * depth


@pytest.mark.parametrize(
    "program",
    [
        f"b({_nested('z')}). !s. +!s <- ?b(X); .term2string(X,T); .term2string(Y,T); X == Y; .print(ok).",
        f"b[{_nested('z', 'a[', ']')}]. !s. +!s <- ?b[A]; .print(ok).",
        f"b({_nested('z', '[', ']')}). !s. +!s <- ?b(X); .print(ok).",
        f"!s({_nested('z')}). +!s(X) <- .print(ok).",
        f"!s. +!s <- X = {_nested('z')}; !g(X). +!g({_nested('Q')}) <- .print(ok).",
        f"!s. +!s <- Y = 2; +g({_nested('Y')}); ?g(X); X = {_nested('2')}; .print(ok).",
        f"c({_nested('z')}). !s. +!s : c({_nested('Q')}) <- .print(ok).",
        f"r({_nested('X')}) :- X = 1. q(Y) :- Y = {_nested('1')}. !s. +!s <- ?r(Y); ?q(Y); .print(ok).",
        f"!s. +!s <- X = {_nested('1', '(1+')}; X = {DEPTH + 1}; .print(ok).",
        f"!s. +!s <- Y = 1; X = {'+'.join(['Y'] * DEPTH)}; X = {DEPTH}; .print(ok).",
        f"a. !s. +!s : {' & '.join(['a'] * DEPTH)} <- .print(ok).",
        f"a. !s. +!s : {' | '.join(['b'] * DEPTH)} | a <- .print(ok).",
        f"!s. +!s <- X = {_nested('1', '{ +!g <- Y = ', ' }')}; .print(ok).",
        f"!s. +!s <- !nest({DEPTH},V,T); V = 1; X = T + 1; X = {DEPTH + 2}; .print(ok). "
        "+!nest(0,T,T). +!nest(N,A,T) <- B = A + 1; !nest(N-1,B,T).",
    ],
    ids=lambda program: program[:20],
)
def test_source_nested_deep_works(program: str) -> None:
    assert run(program).prints == ["ok"]


@pytest.mark.parametrize(
    "program",
    [
        f"a. !s. +!s : {_nested('b', 'not (', depth=TOO_DEEP)} <- .print(no).",
        f"a. !s. +!s <- !nest({TOO_DEEP},a,T); ?T; .print(no). "
        "+!nest(0,T,T). +!nest(N,A,T) <- B = (a & A); !nest(N-1,B,T).",
        f"!s. +!s <- !nest({TOO_DEEP},a,T); +b(T); .print(no). "
        "+!nest(0,T,T). +!nest(N,A,T) <- B = { !g(A) }; !nest(N-1,B,T).",
        "r(N) :- r(N+1). !s. +!s <- .wait(r(1)).",
        '{ register_function("f.a",1,"fa") } fa(N,R) :- R = f.a(N+1). !s. +!s <- X = f.a(1); .print(no).',
        "r(N) :- r(N+1). !s. +!s <- .findall(X,r(X),L); .print(no).",
    ],
    ids=lambda program: program[:20],
)
def test_what_is_too_deep_fails_its_plan_and_nothing_else(program: str) -> None:
    world = run(f"{program} -!s <- .print(handled). !t. +!t <- .print(t).")
    assert sorted(world.prints) == ["handled", "t"]


def test_a_context_that_is_too_deep_leaves_the_event_to_the_next_plan() -> None:
    world = run("r(N) :- r(N+1). !s. +!s : r(1) <- .print(no). +!s <- .print(second).")
    assert world.prints == ["second"]
    assert "too deep" in world.logs[0]


def test_a_goal_condition_that_is_too_deep_does_not_hold() -> None:
    world = run("r(N) :- r(N+1). !s. +!s <: r(1) <- .print(begun). !t. +!t <- +x; .print(t).")
    assert sorted(world.prints) == ["begun", "t"]
    assert "the condition of the goal cannot be computed" in world.logs[0]


def test_a_goal_that_calls_itself_without_end_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agentd.mind.mind.MOST_FRAMES", 20_000)
    world = run("!s. +!s <- !g(0). +!g(N) <- !g(N+1); .print(no). -!s[error(E)] <- .print(E).")
    assert world.prints == ["recursion_too_deep"]


def test_an_initial_belief_or_goal_may_be_nested_a_hundred_thousand_deep() -> None:
    deep = _nested("1", depth=100_000)
    world = run(f"b({deep}). !g({deep}). +!g(f(X)) : b(f(Y)) & X = Y <- .print(same).")
    assert world.prints == ["same"]
