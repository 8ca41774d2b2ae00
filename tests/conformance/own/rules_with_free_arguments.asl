// Rules give all their answers for variables that were free before, in structures too.
p(1). p(2). p(3).
r(f(X)) :- p(X).
s(f(g(X)), X) :- p(X).
late(X) :- X = f(Z) & Z = g(V) & p(V).
app([], L, L).
app([H|T], L, [H|R]) :- app(T, L, R).
!s.
+!s <-
    .print(Y); .findall(Y, r(Y), L); .print(L); .findall(Y, s(f(Y), _), M); .print(M);
    for (r(Z)) { .print(Z) }; !g(Q); !h(W);
    .findall(X, late(X), N); .print(N);
    F = [1|T]; .findall(p(T, U), app(F, U, [1, 2, 3]), K); .print(K).
+!g(X) : r(X) & X = f(2) <- .print(X).
+!h(A) <- for (s(A, B) & B > 1) { .print(A, B) }.
