// Rule 84: in a recursive goal the innermost call's handler runs, the outer calls go on.
!s.
+!s <- !r(3); .print(end).
+!r(0) <- .fail.
+!r(N) <- !r(N - 1); .print(up, N).
-!r(N)[error(E)] <- .print("handler ", N).
