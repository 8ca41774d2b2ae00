{ include("$suite/inc/candidate.asl") }

@differs[test]
+!differs
  <- X = 3;
     !same(X, 4).

@asks_in_vain[test] +!asks_in_vain
  <- ?nothing(7).

@fails_below[test] +!fails_below <- !deeper.
+!deeper <- 2 > 3.

@has_no_plan[test] +!has_no_plan <- !never_written(1).

@acts_without_a_world[test] +!acts_without_a_world <- fly(3).

@passes_between[test] +!passes_between.
