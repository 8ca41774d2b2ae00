// Rules 76 and 83: a sub-goal that fails inside a loop is handled and the loop goes on.
!s.
+!s <- for (.member(X, [1, 2, 3])) { !h(X, Y); .print(X, Y) }; .print(end).
+!h(2, Y) <- .fail.
+!h(X, Y) <- Y = X * 10.
-!h(X, bad) <- .print("handled ", X).
