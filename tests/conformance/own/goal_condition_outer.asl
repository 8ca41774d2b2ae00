// Rule 94: the condition of an outer goal ends the inner goals too.
!s. !f.
+!s <- !outer; .print(outer_done).
+!outer <: x <- !inner; .print(never).
+!inner <: y <- .print(inner); .wait(5000).
+!f <- .wait(10); +x; .wait(10); +y; .print(f).
