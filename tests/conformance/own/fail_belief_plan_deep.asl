// Rule 92: a sub-goal failing inside a plan of +b fails the goal that added b.
b(0).
!s.
+!s <- !g; .print(after).
+!g <- +b(1); .print(never).
+b(X) : X > 0 <- .print("+b"); !sub(X); .print(never).
+!sub(X) <- ?q(X).
-!g[error(E), code(C)] <- .print(E, " ", C).
