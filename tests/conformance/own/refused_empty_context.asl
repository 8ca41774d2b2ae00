// An empty context.
b(1).
+!s : <- a.
