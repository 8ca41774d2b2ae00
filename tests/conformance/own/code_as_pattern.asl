// Rule 96: code in braces as a pattern in triggers, queries and lists takes bodies and plans apart.
keep({ !a(1); !b(2) }). plan_of({ @p +!c(X) : d(X) <- e; f }).
!s.
+!s <-
    !w({ .print(one); .print(two); .print(three) });
    ?keep({ !G; R }); .print(G, " ", R);
    ?plan_of({ @L +!C : K <- B }); .print(L, " ", C, " ", K, " ", B);
    [{ !x; Y }, Z] = [{ !x; !y }, { +z }]; .print(Y, " ", Z);
    !run([{ .print(p) }, { .print(q) }]);
    if ({ +!a } = { -!a }) { .print(never) } else { .print(operators) };
    if ({ +!h } = { +?h }) { .print(never) } else { .print(kinds) };
    { -D } = { -b(2) }; .print(D).
+!w({ H; T }) <- .print(H); H; !w(T).
+!w(B) <- .print(last).
+!run([]).
+!run([B|T]) <- B; !run(T).
