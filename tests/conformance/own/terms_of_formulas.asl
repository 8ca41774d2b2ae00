// Rule 32: logical and relational expressions are terms and print bracketed.
!s.
+!s <-
    .print(1 + 2 * 3 == 7, " ", not (1 < 2) & 3 > 2 | a);
    X = (a & b); .print(X); Y = (not (a | b)); .print(Y); Z = (1 < 2); .print(Z, [Z, (a = b)]);
    W = (X =.. L); .print(W).
