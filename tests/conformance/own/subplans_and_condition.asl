// Rules 94 and 95: nested plans react until the goal condition holds.
!s. !t.
+!s <- !w(3); .print(over).
+!w(L) <: stop(L) <- .print(watch, L); !deep. {
  +!deep <- .print(deep, L); .wait({+never}).
  +tick(X) : X > L <- .print("tick ", X); +stop(L).
}
+!t <- .wait(10); ++tick(1); .wait(10); ++tick(5); .wait(30); ++tick(9); .wait(10); .print(t).
