{ include("../suite/tester.asl") }

@differs[test]
+!differs
  <- X = 3;
     !assert_equals(4, X);
     !assert_equals([a,b], [b,a,b]);            // equal as sets: the test goes on after a failed assertion
     !assert_equals([a,b], [a]).

@in_a_goal_of_its_own[test] +!in_a_goal_of_its_own
  <- !deep_check.

+!deep_check
  <- !assert_true(7 < 3);
     !assert_contains([a, b(1)], b(_));
     !assert_contains([a], c);
     !assert_between(5, 1, 4).

@forced_to_fail[test] +!forced_to_fail <- !force_failure("not yet").

@asks_in_vain[test] +!asks_in_vain
  <- ?nothing(7).

@fails_below[test] +!fails_below <- !deeper.
+!deeper <- 2 > 3.

@has_no_plan[test] +!has_no_plan <- !never_written(1).

@passes_between[test] +!passes_between <- !assert_equals(f(X), f(X)).
