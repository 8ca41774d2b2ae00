// .print_unifier, .list_plans and .list_rules show variables, plans and rules as source text.
// Expected from the specification, not recorded from Jason.
r(X) :- s(X) & X > 1.
@la +!g(X) : X > 1 <- .print("g ", X); !h.
!start.
+!start
   <- X = 3; Y = f(X, Z); .print_unifier;
      .list_plans({ +!g(_) }); .list_plans("+!g(7)"); .list_plans({ +!none }); .list_rules;
      !t(1); !t(2).
+!t(1) <- .list_plans(g); .print("not here").
+!t(2) <- .join; .print("not here").
-!t(N)[error(E)] <- .print(N, " ", E).
