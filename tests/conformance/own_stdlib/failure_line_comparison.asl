// code_line of a failing comparison or equation that stands on a line of its own.
// D8: Jason prints 10 for b, the line where the value of the variable on the left was written.
!start.
+!start <- !a; !b; !c; .stopMAS.
+!a <-
   .print("a");

   1 > 2.
+!b
   <- X = 4;
      .print("b");
      X
      == 5.
+!c <- .print("c"); X = 3; 3 = 4.
-!a[code_line(L)] <- .print(L).
-!b[code_line(L)] <- .print(L).
-!c[code_line(L)] <- .print(L).
