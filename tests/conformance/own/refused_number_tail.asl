// Rule 21: the tail of a list is a variable or a list.
!s.
+!s <- X = [1,2|3].
