// D6 (rule 34): a variable inside a structure that a goal returns stays the caller's.
!s.
+!s <- !same(E, f(G)); G = 1; .print(E); !same(A, B); B = 2; .print(A).
+!same(X, X).
