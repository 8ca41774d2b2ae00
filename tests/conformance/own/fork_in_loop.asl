// Rules 79 and 80: forks in a loop and in one another.
!s.
+!s <-
    for (.member(X, [1, 2])) { .print(p, X) |&| (.print(q, X); .print(r, X)); .print(j, X) };
    (!a(1, R); .print(R)) |&| (!a(2, Q); .print(Q)) ||| .print(z);
    .print(end).
+!a(N, R) <- .print(in, N); R = N * 2.
