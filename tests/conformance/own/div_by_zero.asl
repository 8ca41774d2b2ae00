// D2: div by zero fails the plan only.
!s. !t.
+!s <- !d(0); !d(0.5); !d(2); .print(end).
+!d(N) <- X = 7 div N; .print(X).
-!d(N)[error(E)] <- .print("failed for ", N).
+!t <- .wait(10); .print(t).
