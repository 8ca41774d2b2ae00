// Formulas are joined by one &.
b(1).
+!s : a && b <- c.
