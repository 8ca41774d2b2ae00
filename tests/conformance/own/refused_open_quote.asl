// A quoted atom is not closed.
b(1).
+!s <- X = 'abc.
