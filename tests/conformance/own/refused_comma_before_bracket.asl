// A comma without a term.
b(1).
+!s <- f(a,).
