// Rule 107: the body of for stands in curly brackets.
b(1).
+!s <- for (a) b.
