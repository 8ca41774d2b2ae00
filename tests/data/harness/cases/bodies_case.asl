{ include("../suite/tester.asl") }

+!step(N) <- +did(N).

@takes_apart[test] +!takes_apart
  <- { First; Rest } = { !step(1); !step(2); +did(3) };
     First; Rest;
     .findall(N, did(N), L); .sort(L, Sorted);
     !assert_equals(Sorted, [1,2,3]).

@runs_a_goal[test] +!runs_a_goal
  <- P = { @made_up[extra(7)] +!made(X) : X > 1 <- +made(X); ?made(X) };
     { @L[extra(E)] +!T : C <- B } = P;
     !assert_equals(E, 7);
     .add_plan(P);
     !made(4);
     ?made(V); !assert_equals(V, 4);
     .relevant_plans({ +!made(_) }, [Q], [QL]);
     QL =.. [_, Name, _, As]; !assert_equals(Name, made_up); !assert_equals(As, [extra(7),source(self)]);
     .remove_plan(QL);
     .relevant_plans({ +!made(_) }, None); !assert_equals(None, []).

@runs_what_it_finds[test] +!runs_what_it_finds
  <- .add_plan({ +!found(1) <- +found(1) });
     .relevant_plan({ +!found(_) }, Plan);
     Plan =.. [_, Trigger, true, Body];
     Trigger = { +!Goal };
     !Goal; ?found(1);
     Body;
     .relevant_plans(Trigger, Ps); !assert_equals(Ps, [Plan]).

@knows_its_own_plan[test] +!knows_its_own_plan
  <- .intention(_, _, [im(Label, { +!Goal }, { Formula; _ }, _)|_], current);
     Label =.. [_, Name, _, _]; !assert_equals(knows_its_own_plan, Name);
     Goal =.. [_, Goes, _, _]; !assert_equals(Name, Goes); .print("at ", Formula);
     .plan_label(P, no_setup); P =.. [_, T, _, _]; !assert_equals({ +!setup }, T).

@is_handled_by_a_variable[test] +!is_handled_by_a_variable <- !unheard_of; ?unheard(_).
-!G[error(E)] : .literal(G) & G =.. [_, unheard_of, _, _] <- .print("nobody knows ", G, " (", E, ")"); +unheard(G).
