// Plans found by their trigger are terms that come apart.
b(1).
!s.
+!s <-
    .relevant_plans({ +!g(_) }, L); .length(L, N); .print(N);
    [_, P] = L; { +!G : C <- B } = P; .print(G, " ", C, " ", B);
    .relevant_plans({ +!zz }, Z); .print(Z);
    .add_plan("@z +!z(X) <- .print(zz, X)."); !z(1); .remove_plan(z); !z(2).
-!z(X)[error(E)] <- .print(X, E).
@g1 +!g(1) : b(X) & X > 0 <- .print(one); !h.
@g2[k] +!g(2) : b(Y) <- .print(Y).
