// Rule 96: bodies are taken apart by { H; T }; operators must agree.
!s.
+!s <-
    B = { !a(1); +b(2); -c; ?d(X); .print(X); e }; .print(B);
    { H; T } = B; .print(H, " ", T);
    { H2; T2 } = T; .print(H2);
    { !G; _ } = B; .print(G);
    C = { }; .print(C); D = { !x }; .print(D); { !K } = D; .print(K);
    if ({ +K2; _ } = B) { .print(never) } else { .print("operators differ") };
    P = { @l[k] +!g(Q) : c(Q) & Q > 1 <- .print(Q); !h };
    { @L +!GG : CC <- BB } = P; .print(L, " ", GG, " ", CC, " ", BB);
    +P; +c(2); !g(2).
+!h <- .print(h).
