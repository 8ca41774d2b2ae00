// Rule 82: when all branches of ||| fail the intention ends, no handler is asked.
!s. !t.
+!s <- !x; .print(never).
+!x <- .fail ||| (1 > 2).
-!x[error(E)] <- .print(never, E).
+!t <- .wait(50); .print(t).
