// Formulas in variables are asked, negated, collected and used as contexts and rules.
a. b(1). b(2).
call(G) :- G.
both(F, G) :- F & not G.
!s.
+!s <-
    F = (a & b(X)); if (F) { .print(X) }; ?F; .print(X); G = b(Y); ?G; .print(Y);
    if (call(b(2))) { .print(call) }; if (both(a, b(3))) { .print(both) };
    H = (b(Z) & Z > 1); .findall(Z, H, L); .print(L); .count(H, N); .print(N);
    if (not F) { .print(never) } else { .print(holds) };
    for (G2 = b(W) & G2) { .print(w, W) }; K = (1 > 2); if (K) { .print(never) } else { .print("K does not hold") };
    !c(b(2)); !c(zzz).
+!c(Q) : Q <- .print("context ", Q).
+!c(Q) : not Q <- .print("no context ", Q).
