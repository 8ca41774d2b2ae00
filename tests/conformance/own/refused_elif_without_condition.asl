// Rule 107: elif has a condition.
b(1).
+!s <- if (a) { b } elif { d }.
