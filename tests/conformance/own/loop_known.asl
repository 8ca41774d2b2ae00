// Rule 76: a variable with a value keeps it; the condition only tests it.
p(1,a). p(2,b).
!s.
+!s <-
    K = 3; for (.member(K, [1, 2, 3, 3])) { .print(k, K) };
    for (p(X, Y)) { Z = X; .print(X, Y, Z) }; .print(X, Y, Z);
    for (.member(X, [5, 6])) { W = X * 2; .print(W) };
    if (W = q) { .print(W) };
    for (.member(I, [])) { .fail }; for (false) { .print(no) }; for (true) { .print(once) };
    for (1 < 2) { .print(relation) }; for (not a) { .print("not") }.
