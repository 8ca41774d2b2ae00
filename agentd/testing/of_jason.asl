/* Read in place of the files of Jason's test harness, for the programs that include them: `agentd test` runs the test
   plans itself. What differs from assertions.asl: lists are equal when each member of one is found in the other, in
   any order and number, as Jason's harness compares them. */

@[atomic] +!assert_equals(Expected, Actual) : .list(Expected) | .list(Actual)
  <- agentd.test.same_members(Expected, Actual).
@[atomic] +!assert_equals(Expected, Actual) <- agentd.test.equals(Expected, Actual).

@[atomic] +!check_performance(Goal, Times, Mean)   // of the real time that the goal takes, in nanoseconds
  <- agentd.test.clock(Begun);
     for (.range(_, 1, Times)) { !Goal };
     agentd.test.clock(Ended);
     Mean = (Ended - Begun) / Times.

+!execute_test_plans.                              // programs set this goal for the harness
