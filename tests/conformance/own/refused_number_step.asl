// A number is no formula.
b(1).
+!s <- 3.
