// Rule 61: without an applicable +?g plan -?g runs, and the intention that asked ends.
!s. !t.
+!s <- !x; .print(never).
+!x <- ?q(3); .print(never).
-!x[error(E)] <- .print(never, E).
+?q(X) : X > 5.
-?q(X)[error(E)] <- .print(X, " ", E).
+!t <- .wait(50); .print(t).
