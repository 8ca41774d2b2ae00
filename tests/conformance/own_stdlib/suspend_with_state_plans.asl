// .suspend of a goal that waits as an event, where plans for the states of goals make events of their own: it runs once.
// Expected from the specification, not recorded from Jason.
!start.
+!start <- !!g(1); .suspend(g(_)); .print(start); .wait(50); .resume(g(1)).
-!start <- .print(failed); .resume(g(1)).
+!g(X) <- .print(go(X)).
^!g(X)[state(S)] <- .print(S).
