// Rule 105: a body does not begin with a semicolon.
b(1).
+!s <- ; b.
