// Rule 111: no hexadecimal numbers.
b(1).
+!s <- X = 0x1F.
