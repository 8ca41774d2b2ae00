// A plan without a dot before the next.
b(1).
+!s <- .print(a)

+!t <- b.
