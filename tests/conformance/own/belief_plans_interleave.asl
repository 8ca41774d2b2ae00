// Rules 52 and 67: plans of beliefs in one focus and in their own.
!s.
+a(X) <- .print(a, X); +b(X); .print(a2, X).
+b(X) <- .print(b, X).
+!s <- ++a(1); ++a(2); .print(s1); +a(3); .print(s2).
