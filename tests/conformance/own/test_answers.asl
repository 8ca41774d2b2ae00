// Rules 58 to 61: plans for tests bind variables; compound tests raise no event; failing plans.
t(1). t(2).
!s.
+?q(X, Y) : X > 5 <- Y = big.
+?q(X, Y) <- .print(low); ?t(Y).
+?r(X) <- .fail.
+!s <- ?q(7, A); .print(A); ?q(1, B); .print(B); ?t(2); !x; !y; .print(end).
+!x <- ?r(1); .print(never).
-!x[error(E)] <- .print(E).
+!y <- ?(q(Z, W) & Z > 0); .print(never).
-!y[error(E)] <- .print(E).
