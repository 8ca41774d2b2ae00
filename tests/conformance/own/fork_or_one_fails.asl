// Rule 81: a branch of ||| that fails is tolerated.
!s.
+!s <- !x; .print(after).
+!x <- .fail ||| (.wait(10); .print(b)).
-!x[error(E)] <- .print(never, E).
