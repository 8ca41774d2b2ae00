// Rule 95: nested plans see the variables of the plan around them, their own contexts, tests and goals.
!s.
+!s <- !a(5); !b; .print(end).
+!a(N) : N > 3 <- X = N * 2; !b; !c(Y); .print(Y). {
   +!b : X > 5 <- .print("b sees ", X, N).
   +!c(R) <- R = N + X; ?t(Q); .print(Q).
   +?t(Z) <- Z = N.
   -!d <- .print("d handled").
   +e(V) <- .print("e ", V, N).
}
+!b <- .print("global b").
