// Rule 80: after |&| only the bindings of the branch that ended last are kept, for variables of any age.
!s.
+!s <-
    .print(X, Y);
    (X = 1; .print(x)) |&| (Y = 2; .print(y));
    if (X == 1) { .print("X kept") } else { .print("X lost") };
    if (Y == 2) { .print("Y kept") } else { .print("Y lost") };
    !g(A, B); .print(A, B).
+!g(X, Y) <- .print(go) |&| (.print(z); X = 1; Y = 2).
