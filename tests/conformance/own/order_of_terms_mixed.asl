// Rules 28 to 30: the standard order in relations and sorting.
!s.
+!s <-
    .sort([f(2), f(1,9), f(1), ~f(1), f(1)[x], g, "b", "a", [2], [1,5], [1], [], 3, -1, 2.5, X, f(Y), ns::a], L); .print(L);
    if (a < b & "a" < b & [a] < b & 1 < "a" & f(1) < f(2) & f(2) < g(1)) { .print(less) };
    if (f(9) < f(1,1)) { .print(never) } else { .print("arguments before arity") };
    if (a >= a & [] <= [a] & not (b < a)) { .print(equal) }.
