// Rule 108: relations do not chain.
b(1).
+!s : a == b == c <- c.
