// Rule 107: else belongs to an if.
b(1).
+!s <- else { b }.
