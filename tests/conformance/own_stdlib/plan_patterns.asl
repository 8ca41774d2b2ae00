// A plan term whose parts are variables takes plans apart wherever it stands as an argument.
// Expected from the specification, not recorded from Jason.
!start.
@la[k(1)] +!g(X) : X > 1 <- .print("g ", X).
@lb +!g(1) <- .print(g1).
+!start
   <- .plan_label({ @_ +!T : C <- B }, la); .print(T, " ", C, " ", B);
      .relevant_plan({ +!g(1) }, { @L2 +!T2 : C2 <- B2 }); L2 =.. [N2,_,_]; .print(N2, " ", T2, " ", C2, " ", B2);
      .member({ @L3 +!T3 <- B3 }, [{ @z +!q <- a }]); .print(L3, " ", T3, " ", B3);
      if (.relevant_plan({ +!g(_) }, { @_ +!T4 : true <- B4 })) { .print(T4, " ", B4) }.
