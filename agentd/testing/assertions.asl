/* The goals by which test plans say what they expect, and the goal that runs one test plan: the goal of the plan is
   put in the place of !agentd_the_goal.
   A program that has plans of its own for one of these assertions keeps them. */

+!assert_equals(Expected, Actual)            <- agentd.test.equals(Expected, Actual).
+!assert_equals(Expected, Actual, Tolerance) <- agentd.test.close(Expected, Actual, Tolerance).
+!assert_not_equals(Unwanted, Actual)        <- agentd.test.differs(Unwanted, Actual).
+!assert_true(Formula)                       <- agentd.test.holds(Formula).
+!assert_false(Formula)                      <- agentd.test.fails(Formula).
+!assert_contains(Whole, Part)               <- agentd.test.contains(Whole, Part).
+!assert_not_contains(Whole, Part)           <- agentd.test.lacks(Whole, Part).
+!force_pass                                 <- agentd.test.pass.
+!force_failure                              <- agentd.test.fail("the test plan forces a failure").
+!force_failure(Why)                         <- agentd.test.fail(Why).

+!agentd_run_test <- !agentd_the_goal; agentd.test.ended.
-!agentd_run_test[error(Error), error_msg(Why), code(Formula), code_line(Line), code_src(File)]
  <- agentd.test.failed(Error, Why, Formula, Line, File).
