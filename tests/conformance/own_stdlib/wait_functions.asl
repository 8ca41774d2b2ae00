// A function in a formula that is waited for is computed once, before; a condition as internal action is asked each time.
// Expected from the specification, not recorded from Jason.
b(1).
!start.
+!more <- .wait(100); +b(2); .wait(100); +b(3); +c([1,2,3]).
+!start
   <- !!more; !t(1); !t(2); !t(3);
      N = 3; .wait(.count(b(_)) == N, 100); .print("true already");
      .wait(b(X) & math.abs(X - 5) == 3, 100); .print("what needs the formula's variables is computed each time: ", X);
      L = [x,y]; .wait(.length(L) + .count(b(_)) == 5 & c(M) & .length(M) > 2, 100); .print(M).
+!t(1) <- .wait(.count(b(_)) >= 3, 500); .print("not here").
+!t(2) <- .wait(.count(b(_), 3), 500); .print("three now").
+!t(3) <- .wait(not .count(b(_)) == 3, 100); .print("not here").
-!t(N)[error(E)] <- .print(N, " ", E).
