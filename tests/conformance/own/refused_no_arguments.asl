// Rule 23: no empty brackets.
b(1).
+!s <- f().
