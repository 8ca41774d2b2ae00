// Rule 21: a list has one tail.
!s.
+!s <- X = [a|B,c].
