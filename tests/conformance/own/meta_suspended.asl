// Rule 74: states of goals that are suspended, resumed, ended or dropped by internal actions.
!s.
^!g(X)[state(S)] <- .print("g ", X, " ", S).
+!g(1) <- .suspend; .print(resumed).
+!g(X) <- .wait(1000); .print(never).
+!s <-
    !!g(1); .wait(20); .resume(g(1)); .wait(20);
    !!g(2); .wait(20); .succeed_goal(g(2)); .wait(20);
    !!g(3); .wait(20); .fail_goal(g(3)); .wait(20);
    !!g(4); .wait(20); .drop_intention(g(4)); .wait(20);
    !!g(5); .wait(20); .suspend(g(5)); .wait(20); .print(end); .stopMAS.
