// Rule 107: the condition of while stands in round brackets.
b(1).
+!s <- while a { b }.
