// Rule 92: a failing plan of -b ends the intention, no handler is asked.
b(1).
!s. !t.
+!s <- !x; .print(never).
+!x <- -b(1); .print(never).
-!x[error(E)] <- .print(never, E).
-b(X) <- .print(gone, X); .fail.
+!t <- .wait(50); .print(t).
