// Arithmetic is no formula.
b(1).
+!s <- X + 1.
