// Rule 100: a plain variable takes no literal of another namespace, ns::V and N::p(X) do.
n::p(1). p(2). m::p(3). b(n::a).
!s.
+!s <-
    X = p(2); .print(X);
    if (Y = n::p(1)) { .print(never) } else { .print("plain does not take n") };
    n::V = n::p(1); .print(V);
    if (f(W) = f(n::q)) { .print(never) } else { .print("nor inside a structure") };
    if (b(A)) { .print(never) } else { .print("nor in a query") };
    ?N::p(3); .print(N);
    .findall(NS, NS::p(_), L); .length(L, K); .print(K);
    if (n::p(1) == p(1)) { .print(never) } else { .print(differ) };
    !g(n::a).
+!g(X) <- .print(never).
-!s[error(E)] <- .print(E).
