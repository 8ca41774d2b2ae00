// Rule 90: a failure inside a handler climbs to the goal below.
!s.
+!s <- !a; .print("start goes on").
+!a <- !b; .print(never).
+!b <- .fail.
-!b <- .print("-!b"); .fail; .print(never).
-!a[error(E)] <- .print("-!a ", E).
