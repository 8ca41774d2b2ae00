// Rule 12: there is no is.
!s.
+!s <- X is 2.
