// Rules 37, 40, 42 and 43: annotations from variables and lists, sources from variables.
!s.
+b(X)[source(S)|R] <- .print(X, S, R).
+!g(X)[source(S)|R] <- .print(g, X, S, R).
+!s <-
    L = [x, y(1)]; +b(1)[k|L]; ?b(1)[y(Q)]; .print(Q); -b(1)[k|L];
    if (b(1)) { .print(never) } else { .print(gone) };
    S = tom; +c(1)[source(S)]; ?c(1)[source(W)]; .print(W); +c(1)[source(ann), p(2)];
    .findall(Z, c(1)[source(Z)], M); .print(M); -c(1)[source(tom)]; ?c(1)[p(P)]; .print(P);
    +b(2)[source(tom), z]; !g(1)[p]; !g(2)[source(ann), q(1)].
