// Of team.mas2j: does what bob asks for.
+!fetch(X) : place(X, P) <- go(P); !report(X).
+!report(X) <- .print(X).
