// The same plan added again gets one source more and goes with its last one; labels name one plan; generated ones are made new.
// Expected from the specification, not recorded from Jason.
@one +!g(1) <- .print(one).
+!g(2) <- .print(two).
!start.
+!start
   <- .add_plan({ +!h(X) <- .print("h ", X) }); .add_plan("+!h(X) <- .print(\"h \", X).", tom);
      .relevant_plans({ +!h(_) }, [P], [L]); L =.. [_,_,Ss]; .print(Ss);
      .remove_plan(L); !h(1); .remove_plan(L, tom); !t(1);
      for (.member(V, [1,1,2])) { .add_plan({ +!k(N) <- .print(N, " ", V) }) };
      .relevant_plans({ +!k(_) }, Ks); .length(Ks, K); .print(K);
      .relevant_plans({ +!g(2) }, G2); .add_plan(G2); .relevant_plans({ +!g(2) }, G2b); .length(G2b, K2); .print(K2);
      !t(2); !t(3);
      .plan_label(One, one); .remove_plan(One); !t(4).
+!t(1) <- !h(1).
+!t(2) <- .add_plan({ @one +!other <- .print(other) }).
+!t(3) <- .save_agent("own.asl"); .include("own.asl"); .print("not here").
+!t(4) <- !g(1).
-!t(N)[error(E)] <- .print(N, " ", E).
