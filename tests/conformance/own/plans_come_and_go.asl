// Rule 97: plans are added before the others, with the values of their variables, and removed by label.
!s.
+!g(1) <- .print(one).
+!s <- !g(1); X = 7; +{ @n1 +!g(Y) : Y > 1 <- .print(new, Y, X) }; !g(1); !g(2); -{ @n1 +!g(Y) : Y > 1 <- .print(new, Y, X) }; !x; .add_plan({ +!g(3) <- .print(three) }); !g(3).
+!x <- !g(2).
-!x[error(E)] <- .print(E).
