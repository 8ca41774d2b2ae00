"""The programs of the textbooks, and how bindings flow through a body: what each prints, worked out by hand."""

from __future__ import annotations

import re

import pytest

from tests.agentd.minds import run

LISTS = """
append([], L, L).
append([H|T], L, [H|R]) :- append(T, L, R).
reverse(L, R) :- reverse(L, [], R).
reverse([], A, A).
reverse([H|T], A, R) :- reverse(T, [H|A], R).
member(X, [X|_]).
member(X, [_|T]) :- member(X, T).
select(X, [X|T], T).
select(X, [H|T], [H|R]) :- select(X, T, R).
permutation([], []).
permutation(L, [H|T]) :- select(H, L, R) & permutation(R, T).
length([], 0).
length([_|T], N+1) :- length(T, N).
sum([], 0).
sum([H|T], H+S) :- sum(T, S).
last([X], X).
last([_|T], X) :- last(T, X).
"""

QUERIES = [
    ("L", "append([1,2], [3], L)", "", "[[1,2,3]]"),
    ("p(A,B)", "append(A, B, [1,2])", "", "[p([],[1,2]),p([1],[2]),p([1,2],[])]"),
    ("X", "append(_, [X], [1,2,3])", "", "[3]"),
    ("X", "append([1|X], [4], [1,2,4])", "", "[[2]]"),
    ("R", "reverse([1,[2,3],4], R)", "", "[[4,[2,3],1]]"),
    ("X", "reverse([1,X,3], [3,2,1])", "", "[2]"),
    ("X", "member(X, [a,b,a])", "", "[a,b,a]"),
    ("X", "member(f(X,1), [f(a,1),f(b,2),g(c,1),f(d,1)])", "", "[a,d]"),
    ("P", "permutation([1,2,3], P)", "", "[[1,2,3],[1,3,2],[2,1,3],[2,3,1],[3,1,2],[3,2,1]]"),
    ("X", "permutation([1,2,3], [3,X|_])", "", "[1,2]"),
    ("N", "length([a,b,c], N)", "", "[3]"),
    ("yes", "length([a,b,c], N) & N == 3 & not (length([a], M) & M == 2)", "", "[yes]"),
    ("S", "sum([1,2.5,3], S)", "", "[6.5]"),
    ("p(X,R)", "select(X, [1,2], R) & not member(2, R)", "", "[p(2,[1])]"),
    ("X", "last([1,2,f(3)], f(X))", "", "[3]"),
    ("X", "same(X, 3)", "same(X, X).", "[3]"),
    ("yes", "same(f(1,2), f(1,2)) & not same(f(1), f(2))", "same(A, A) :- true.", "[yes]"),
    ("X", "same(f(X,2), f(1,_))", "same(A, A) :- true.", "[1]"),
    ("X", "same(X, X)", "same(1, 1). same(A, A) :- A = 2. same(1, 2).", "[1,2]"),
    ("X", "differ(X, X)", "differ(A, B) :- d(A) & d(B) & A \\== B. d(1). d(2).", "[]"),
    ("Y", "inc(3, Y)", "inc(X, X+1) :- true.", "[4]"),
    ("yes", "inc(3, 4) & not inc(3, 5)", "inc(X, X+1) :- true.", "[yes]"),
    ("Y", "twice(2, Y)", "inc(X, X+1) :- true. twice(X, Z) :- inc(X, Y) & inc(Y*10, Z).", "[31]"),
    ("F", "factorial(5, F)", "factorial(0, 1). factorial(N, N*F) :- N > 0 & factorial(N-1, F).", "[120]"),
    ("F", "fib(10, F)", "fib(0,0). fib(1,1). fib(N,A+B) :- N > 1 & fib(N-1,A) & fib(N-2,B).", "[55]"),
    ("M", "max(M)", "v(3). v(7). v(5). max(X) :- v(X) & not (v(Y) & Y > X).", "[7]"),
    ("X", "even(X)", "n(1). n(4). even(X) :- n(X) & ev(X). ev(0). ev(N) :- N > 0 & od(N-1). od(N) :- N > 0 & ev(N-1).",
     "[4]"),
    ("X", "lone(X)", "on(a,b). on(c,d). b(a). b(b). b(c). b(d). lone(X) :- b(X) & not on(_,X) & not on(X,_).", "[]"),
    ("X", "clear(X)", "on(a,b). on(c,d). b(a). b(b). b(c). b(d). clear(X) :- b(X) & not on(_,X).", "[a,c]"),
    ("T", "tower(T)",
     "on(c,b). on(b,a). on(a,table). on(d,table). clear(X) :- on(X,_) & not on(_,X). "
     "tower([X|T]) :- clear(X) & below(X,T). below(X,[]) :- on(X,table). below(X,[Y|T]) :- on(X,Y) & Y \\== table & "
     "below(Y,T).", "[[c,b,a],[d]]"),
    ("X", "tower([X,b|_])",
     "on(c,b). on(b,a). on(a,table). tower([X]) :- on(X,table). tower([X,Y|T]) :- on(X,Y) & tower([Y|T]).", "[c]"),
    ("P", "path(a, d, P)",
     "e(a,b). e(b,c). e(c,a). e(c,d). e(a,d). path(X,Y,P) :- walk(X,Y,[X],P). walk(X,X,V,P) :- reverse(V,P). "
     "walk(X,Y,V,P) :- e(X,Z) & not member(Z,V) & walk(Z,Y,[Z|V],P).", "[[a,b,c,d],[a,d]]"),
    ("Q", "queens([1,2,3,4], Q)",
     "queens(L,Q) :- permutation(L,Q) & safe(Q). safe([]). safe([H|T]) :- no_attack(H,T,1) & safe(T). "
     "no_attack(_,[],_). no_attack(H,[X|T],D) :- H \\== X+D & H \\== X-D & no_attack(H,T,D+1).",
     "[[2,4,1,3],[3,1,4,2]]"),
    ("p(N,L)", "team(N, L)", "in(a,1). in(b,2). in(c,1). n(1). n(2). team(N,L) :- n(N) & .findall(X, in(X,N), L).",
     "[p(1,[a,c]),p(2,[b])]"),
    ("N", "some(a, N)", "in(a,1). in(a,2). some(X,N) :- .count(in(X,_), N).", "[2]"),
    ("p(X,Y)", "either(X, Y)", "either(X, Y) :- X = 1 | Y = 2 | X = 3 & Y = 4.", "[p(1,_),p(_,2),p(3,4)]"),
    ("X", "deep(f([X,g(1)]))", "deep(f([A,g(B)])) :- A = B. deep(f([A,g(2)])) :- A = 2.", "[1]"),
    ("X", 'named("a", X)', 'named("a", 1) :- true. named(a, 2) :- true. named("a", [x|_]) :- true.', "[1,[x|_]]"),
    ("X", "noted(1)[of(X)]", "noted(1)[of(2),of(3)]. noted(N)[of(N+9)] :- N = 1.", "[2,3,10]"),
    ("yes", "not free(f(1,_)) & free(f(2,_))", "used(f(1,a)). free(X) :- not used(X).", "[yes]"),
    ("X", "outer(f(1,X))", "inner(f(1,a)). inner(f(2,b)). outer(X) :- middle(X). middle(Y) :- inner(Y).", "[a]"),
    ("X", "big(f(X,5))", "v(f(1,5)). v(f(2,6)). big(f(A,B)) :- B > 4 & v(f(A,B)).", "[1]"),
]  # fmt: skip


@pytest.mark.parametrize(("shown", "query", "clauses", "answers"), QUERIES)
def test_a_program_of_the_textbooks_has_its_answers(shown: str, query: str, clauses: str, answers: str) -> None:
    goals = f"""
        there :- {query}.
        !go. +!go <- !found; !each.
        +!found : there & .findall({shown}, {query}, Found) <- .print(Found).
        +!found <- .print([]).
        +!each <- for ({query} & Shown = {shown}) {{ .print(Shown) }}."""
    found, *each = (re.sub(r"\b[A-Z_]\w*", "_", line) for line in run(f"{LISTS}{clauses}{goals}").prints)
    assert found == answers
    assert f"[{','.join(each)}]" == answers


BODIES = [
    ("?p(X); ?q(X,Y); .print(X,Y)", "p(1). q(2,b). q(1,a).", ["1a"]),
    ("X = f(A,1); ?p(X); .print(X,A)", "p(f(2,2)). p(f(3,1)).", ["f(3,1)3"]),
    ("X = f(A,1); ?p(X); .print(X,A)", "p(f(N,2)) :- true. p(f(N,M)) :- M = 1 & N = 3.", ["f(3,1)3"]),
    ("!g(X); .print(X)", "+!g(Y) <- Y = 7.", ["7"]),
    ("!g(X); .print(X)", "+!g(Y) <- ?p(Y). p(5). p(6).", ["5"]),
    ("!g(f(X,1),Y); .print(X,Y)", "+!g(f(A,B),C) <- A = B+1; C = A*10.", ["220"]),
    ("!g(f(X,1),X); .print(X)", "+!g(f(A,B),C) <- B = A; ?(C == 1).", ["1"]),
    ("!g([X|T]); .print([X|T])", "+!g(L) <- L = [1,2,3].", ["[1,2,3]"]),
    ("!g([X|T]); .print(X,T)", "+!g([1|[2|R]]) <- R = [].", ["1[2]"]),
    ("!g(X,X); .print(X)", "+!g(A,B) <- A = 4; .print(B).", ["4", "4"]),
    ("!g(1,X); .print(X)", "+!g(A,A+1).", ["2"]),
    ("X = 2; !g(X+1,Y); .print(Y)", "+!g(A,B) <- B = A*A.", ["9"]),
    ("!g(X); .print(X)", "+!g(1) : p(2). +!g(2) : p(X) & X > 2. +!g(N) : p(N). p(1).", ["1"]),
    ("?g(X); .print(X)", "+?g(Y) <- Y = 3.", ["3"]),
    ("?g(f(X,2)); .print(X)", "+?g(f(A,B)) : B < 2 <- A = no. +?g(f(A,B)) <- A = B+1.", ["3"]),
    ("if (p(X)) { .print(X) }; .print(X)", "p(1). p(2).", ["1", "1"]),
    ("if (p(9)) { X = 1 } else { X = 2 }; .print(X)", "p(1).", ["2"]),
    ("if (p(X) & X > 5) { .print(X) } elif (p(X)) { .print(low,X) }; X = 1; .print(X)", "p(1).", ["low1", "1"]),
    ("for (p(X)) { Y = X*2; .print(Y) }; X = a; Y = b; .print(X,Y)", "p(1). p(2).", ["2", "4", "ab"]),
    ("X = 2; for (p(X,Y)) { .print(Y) }; .print(X)", "p(1,a). p(2,b). p(2,c).", ["b", "c", "2"]),
    ("F = f(A,1); for (p(F)) { .print(A) }; A = z; .print(F)", "p(f(1,1)). p(f(2,2)). p(f(3,1)).",
     ["1", "3", "f(z,1)"]),
    ("for (.member(f(X,1), [f(a,1),f(b,2),f(c,1)])) { .print(X) }", "", ["a", "c"]),
    ("for (p(X) & .count(q(X,_), N)) { .print(X,N) }", "p(1). p(2). p(3). q(1,a). q(3,a). q(3,b).", ["11", "20", "32"]),
    ("for (p(X) & .findall(Y, q(X,Y), L)) { .print(X,L) }", "p(1). p(2). q(1,a). q(1,b).", ["1[a,b]", "2[]"]),
    ("+n(0); while (n(I) & I < 3) { -+n(I+1); J = I }; I = x; J = y; .print(I,J)", "", ["xy"]),
    ("!g(X); .print(X)", "+!g(Y) <- Y = 1; .fail. -!g(Y) <- Y = 2.", ["2"]),
    ("!g(f(X,Z)); .print(X,Z)", "+!g(f(A,B)) <- A = 1; !h(B). +!h(C) <- C = 5; ?nothing. -!g(f(A,B)) <- B = 2; A = 3.",
     ["32"]),
    ("?p(X); !g(X,Y); .print(Y)", "p(1). +!g(A,B) : B = A+1. ", ["2"]),
    (".findall(p(X,Y), q(X,Y), [p(A,B)|_]); .print(A,B)", "q(1,2). q(3,4).", ["12"]),
    (".findall(job(X,Who), p(X), L); Who = me; .print(L)", "p(1). p(2).", ["[job(1,me),job(2,me)]"]),
    ("L = [1,2|T]; T = [3]; ?sum(L,S); .print(S)", "", ["6"]),
    ("?append(X,[3],[1,2,3]); ?append(X,Y,[1,2,4]); .print(X,Y)", "", ["[1,2][4]"]),
    ("G = p(f(X,2)); ?G; .print(X)", "p(f(1,1)). p(f(N,M)) :- N = M*2.", ["4"]),
    ("P = p(X); .findall(X, P & X > 1, L); .print(L)", "p(1). p(2). p(3).", ["[2,3]"]),
    ("?(not p(f(2,_))); ?(not (p(f(X,_)) & X > 1)); .print(ok)", "p(f(1,1)).", ["ok"]),
    ("!sort([3,1,2],S); .print(S)",
     "+!sort(L,S) : permutation(L,S) & ordered(S). ordered([_]). ordered([A,B|T]) :- A <= B & ordered([B|T]).",
     ["[1,2,3]"]),
    ("!hanoi(2,a,b,c)", "+!hanoi(0,_,_,_). +!hanoi(N,A,B,C) <- !hanoi(N-1,A,C,B); .print(A,B); !hanoi(N-1,C,B,A).",
     ["ac", "ab", "cb"]),
    ("!len([a,b,c],N); .print(N)", "+!len([],0). +!len([_|T],M+1) <- !len(T,M).", ["3"]),
    ("!rev([1,2,3],[],R); .print(R)", "+!rev([],A,A). +!rev([H|T],A,R) <- !rev(T,[H|A],R).", ["[3,2,1]"]),
    ("F = f(A); for (p(F)) { .print(A); !set(B,F); .print(B) }; A = z; B = b; .print(F,B)",
     "p(f(1)). p(f(2)). +!set(B,F) <- B = F.", ["1", "f(1)", "2", "f(2)", "f(z)b"]),
    ("F = f(A); for (.member(X,[1,2])) { !set(F,X); .print(F) }; A = z; .print(F)",
     "+!set(f(X),X).", ["f(1)", "f(2)", "f(z)"]),
    ("L = [A|T]; for (r(L)) { .print(A,T) }; A = z; .print(L)",
     "r([X,Y]) :- .member(X,[1,2]) & Y = X*2.", ["1[2]", "2[4]", "[z|T]"]),
    ("F = f(A); +n(0); while (n(I) & I < 2 & F = f(I)) { .print(A); -+n(I+1) }; A = z; .print(F)", "",
     ["0", "1", "f(z)"]),
    ("-p(f(X,2)); .print(X); ?p(Y); .print(Y)", "p(f(1,1)). p(f(3,2)).", ["3", "f(1,1)"]),
    ("+q(f(X,1)); X = 5; ?q(f(Y,Z)); .print(Z)", "", ["1"]),
]  # fmt: skip


@pytest.mark.parametrize(("body", "clauses", "prints"), BODIES)
def test_bindings_flow_through_a_body(body: str, clauses: str, prints: list[str]) -> None:
    assert run(f"{LISTS}{clauses} !go. +!go <- {body}.").prints == prints
