// Rules 85 and 86: error, code and line of each kind of failure.
!s.
+!s <- !a(1); !a(2); !a(3); !a(4); !a(6); .print(end).
+!a(1) <- X = 2; X < 1.
+!a(2) <- ?p(3)[k].
+!a(3) <- .fail(why(wind), error_msg("too windy")).
+!a(4) <-
    .print("goes on for lines");
    !nope(1)[x].
+!a(6) <- if (1 < 2) { for (.member(X, [1, 2])) { while (X < 5) { ?(X > 7) } } }; .print(never).
-!a(N)[error(E), error_msg(M), code(C), code_line(L)] <- .print(N, " ", E, " | ", M, " | ", C, " ", L).
