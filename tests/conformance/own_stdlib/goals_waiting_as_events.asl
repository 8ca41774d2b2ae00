// .succeed_goal, .fail_goal, .suspend and .drop_desire of goals that have no plan yet, with and without a caller.
// Expected from the specification, not recorded from Jason.
!start.
+!g(N) <- .print("g ", N).
-!h(N)[error(E)] <- .print("h ", N, " failed: ", E).
+!h(N) <- .print("h ", N).
+!calls(N) <- !h(N); .print("caller of ", N, " goes on").
+!quiet(N) <- !g(N); .print("caller of ", N, " goes on").
-!quiet(N)[error(E)] <- .print("handler of the caller of ", N, ": ", E).
+!q(N) : ready(N) <- .print("q ", N).
@one[atomic] +!events <- !!g(1); .succeed_goal(g(1)); !!h(2); .fail_goal(h(2)); !!g(3); .fail_goal(g(3)).
@two[atomic] +!held
   <- !!q(5); .suspend(q(5)); .findall(N, .desire(q(N)), D); .findall(N, .intend(q(N)), I); .print(D, I);
      if (.suspended(q(5), R)) { .print(R) };
      !!q(6); .suspend(q(6)); .drop_desire(q(6)); .findall(N, .desire(q(N)), L); .print(L).
+!start
   <- !events; .wait(50); .print("--");
      !held; .wait(50); .print("not begun"); +ready(5); .resume(q(_)); .wait(50); .print("--");
      !subgoals; .wait(100); .stopMAS.
@three[atomic] +!subgoals <- !!calls(7); !!quiet(8); !!calls(9); !!quiet(10); !!end; for (.range(_, 1, 60)) { !!pad }.
+!pad.
+!end <- .succeed_goal(h(7)); .fail_goal(g(8)); .fail_goal(h(9)); .succeed_goal(g(10)).
