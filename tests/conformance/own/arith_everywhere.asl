// Rules 11 and 14: arithmetic in heads of rules, facts, goals, nested terms; symbolic while it is open.
p(N) :- N = M + 1 & M = 4.
half(2*3, 7/2). area(X * 2) :- X = 3.
!s.
+!s <-
    ?p(A); .print(A); ?half(B, C); .print(B, " ", C); ?area(D); .print(D);
    +k(A * A); ?k(25); .print(ok); !g(A - 1);
    X = Y * 2 + Z; .print(X); Y = 3; Z = 1; .print(X, " ", f(X, [Y + Z])).
+!g(4) <- .print(four).
+!g(X) <- .print(other, X).
