// Rule 15: no arithmetic on atoms.
b(1).
+!s <- X = a - 1.
