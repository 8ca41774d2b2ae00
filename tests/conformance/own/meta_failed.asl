// Rule 74: the states of a goal that fails come as events of their own and interleave with its handler.
!s.
^!g(X)[state(S)] <- .print("meta ", X, " ", S).
+!g(X) <- .print("in ", X); .fail.
-!g(X) <- .print("handler ", X).
+!s <- !g(1); .print(after); .wait(100).
