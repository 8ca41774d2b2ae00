{ include("$suite/inc/candidate.asl") }

+!step(N) <- +did(N).

@takes_apart[test] +!takes_apart
  <- { First; Rest } = { !step(1); !step(2); +did(3) };
     First; Rest;
     .findall(N, did(N), L); .sort(L, Sorted);
     !same(Sorted, [1,2,3]).

@runs_a_goal[test] +!runs_a_goal
  <- P = { @made_up[extra(7)] +!made(X) : X > 1 <- +made(X); ?made(X) };
     { @L[extra(E)] +!T : C <- B } = P;
     !same(E, 7);
     .add_plan(P);
     !made(4);
     ?made(V); !same(V, 4);
     .relevant_plans({ +!made(_) }, [Q], [QL]); .length([Q,QL], 2);
     QL =.. [_, Name, _, As]; !same(Name, made_up); !same(As, [extra(7),source(self)]);
     .remove_plan(QL);
     .relevant_plans({ +!made(_) }, None); !same(None, []).

@runs_what_it_finds[test] +!runs_what_it_finds
  <- .add_plan({ +!found(1) <- +found(1) });
     .relevant_plan({ +!found(_) }, Plan);
     Plan =.. [_, Trigger, true, Body];
     Trigger = { +!Goal };
     !Goal; ?found(1);
     Body;
     .relevant_plans(Trigger, Ps); !same(Ps, [Plan]).

@knows_its_caller[test] +!knows_its_caller <- !same(1, 1); ?checked(Label, Formula);
     Label =.. [_, knows_its_caller, _, _];
     Formula = { !Called }; Called = same(1, 1).

@is_handled_by_a_variable[test] +!is_handled_by_a_variable <- !unheard_of; ?unheard(_).
-!G[error(E)] : .literal(G) & G =.. [_, unheard_of, _, _] <- .print("nobody knows ", G, " (", E, ")"); +unheard(G).
