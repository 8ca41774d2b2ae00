/* The goals by which test plans say what they expect, and the goal that runs one test plan: the goal of the plan is
   put in the place of !agentd_the_goal.
   A program that has plans of its own for one of these assertions keeps them. */

@[atomic] +!assert_equals(Expected, Actual)            <- agentd.test.equals(Expected, Actual).
@[atomic] +!assert_equals(Expected, Actual, Tolerance) <- agentd.test.close(Expected, Actual, Tolerance).
@[atomic] +!assert_not_equals(Unwanted, Actual)        <- agentd.test.differs(Unwanted, Actual).
@[atomic] +!assert_true(Formula)                       <- agentd.test.holds(Formula).
@[atomic] +!assert_false(Formula)                      <- agentd.test.fails(Formula).
@[atomic] +!assert_greater_than(Number, Bound)         <- agentd.test.greater(Number, Bound).
@[atomic] +!assert_greater_than_equals(Number, Bound)  <- agentd.test.at_least(Number, Bound).
@[atomic] +!assert_between(Number, Lowest, Highest)    <- agentd.test.between(Number, Lowest, Highest).
@[atomic] +!assert_contains(Whole, Part)               <- agentd.test.contains(Whole, Part).
@[atomic] +!assert_not_contains(Whole, Part)           <- agentd.test.lacks(Whole, Part).
@[atomic] +!force_pass                                 <- agentd.test.pass.
@[atomic] +!force_failure                              <- agentd.test.fail("the test plan forces a failure").
@[atomic] +!force_failure(Why)                         <- agentd.test.fail(Why).

+!agentd_run_test <- !agentd_the_goal; agentd.test.ended.
-!agentd_run_test[error(Error), error_msg(Why), code(Formula), code_line(Line), code_src(File)]
  <- agentd.test.failed(Error, Why, Formula, Line, File).
