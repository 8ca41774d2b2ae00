// Rules 67 to 69: sub-goals, belief plans and if each take their steps in the round robin.
!a. !b.
+!a <- .print(a1); !sub(a); .print(a2).
+!b <- .print(b1); +x(b); .print(b2); if (true) { .print(b3) }; .print(b4).
+!sub(X) <- .print(sub, X); X = a; .print(sub2, X).
+x(B) <- .print(plan, B).
