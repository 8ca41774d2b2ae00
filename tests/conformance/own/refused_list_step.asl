// A list is no formula.
b(1).
+!s <- [a].
