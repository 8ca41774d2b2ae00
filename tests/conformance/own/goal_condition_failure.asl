// Rules 83 and 94: a goal with a condition that fails is handled like any other.
!s.
+!s <- !g; .print(after).
+!g <: done <- .print(try); .fail.
-!g <- .print(handle); +done.
