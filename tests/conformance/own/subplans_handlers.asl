// Rule 95: nested plans for events of the goal and for failures of its sub-goals.
!s.
+!s <- !a(1); .print(done); ++e(3); .wait(20).
+!a(N) <- +e(1); .wait(10); +e(2); !d. {
   +e(V) : V < 2 <- .print("inner e ", V, N).
   -!d[error(E)] <- .print("d handled ", E).
}
+e(V) <- .print("outer e ", V).
