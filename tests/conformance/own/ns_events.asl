// Rule 99: events of a namespace with sources, tests and failures.
!s.
+n::b(X)[source(S)] <- .print("n b ", X, " ", S).
-n::b(X) <- .print("n -b ", X).
+?n::q(X) <- X = 5.
-!n::g(X)[error(E)] <- .print("n g ", X, " ", E).
+!s <- +n::b(1); -n::b(1); ?n::q(Y); .print(Y); !n::g(3); .print(f(n::a, n::b(1)[k]), " ", [~n::d(2)]).
