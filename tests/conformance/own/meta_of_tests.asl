// Rule 74: states of test goals; a free variable of a goal stays free in the events of its states.
!s.
^?q(X)[state(S)] <- .print("q ", X, " ", S).
^!g(X)[state(S)] : not (X == 5) <- if (X = free) { .print("g free ", S) }.
^!g(X)[state(S)] <- .print("g ", X, " ", S).
+?q(X) : X > 2 <- .print(asked).
+!g(X) <- X = 5.
+!s <- ?q(3); .print(after); !g(Y); .print(Y); .wait(30).
