// Rules 49, 77 and the belief operators inside loops.
n(1). n(2). n(3). q([1,2]).
!s.
+!s <-
    for (n(X)) { +n(X + 10); -n(X) }; .findall(X, n(X), L); .print(L);
    while (q([H|T])) { .print(H); -+q(T) };
    while (not done) { if (cnt(C)) { if (C > 1) { +done } else { -+cnt(C + 1) } } else { +cnt(0) } }; ?cnt(F); .print(F);
    +>k(1); +<k(2); ++k(3); --k(1); .findall(X, k(X), M); .print(M); -k(Y); .print(Y).
