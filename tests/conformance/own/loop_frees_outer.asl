// Rule 76: a variable that was free before a loop is free again in each round and afterwards.
c(0).
!s.
+!s <-
    .print(X); T = f(X);
    for (.member(Y, [1, 2])) { !same(Y, X); W = X * 2; .print(T, " ", W) };
    .print(T);
    while (c(N) & N < 2) { X = N; .print(X); -+c(N + 1) };
    .print(X);
    for (.member(X, [5, 6])) { V = f(X); .print(V) };
    !out(Q); .print(Q).
+!same(A, A).
+!out(R) <- for (.member(Y, [a, b])) { R = Y; .print(R) }; R = c.
