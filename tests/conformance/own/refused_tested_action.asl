// Rule 109: no ? before an internal action.
b(1).
+!s <- ?.print(a).
