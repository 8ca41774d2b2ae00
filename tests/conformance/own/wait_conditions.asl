// Waiting for formulas and events binds their variables; a limit with a third argument goes on.
!s. !t.
+!s <-
    .wait(b(X) & X > 1); .print(X); .wait({+c(Y)}); .print(Y);
    .wait(z, 30, E); .print(late); .wait(not b(1)); .print(end).
+!t <- .wait(10); +b(1); .print(b1); .wait(10); +b(2); .wait(10); +c(7); .wait(60); -b(1); .print(gone).
