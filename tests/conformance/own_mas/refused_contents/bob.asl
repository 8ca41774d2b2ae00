// What is no belief, goal, event or label is refused with a communication error; the members of lists that are none are skipped.
// Expected from the specification, not recorded from Jason.
// order: per-agent
b(1).
+a(X)[source(S)] <- .print("a ", X, " ", S).
+~a(X) <- .print("not a ", X).
+!g(X)[source(S)] <- .print("g ", X, " ", S).
+s(X) <- .print("s ", X).
-!kqml_received(S, P, C, M)[error(E)] <- .print(E, " ", P, " ", C, " of ", S).
