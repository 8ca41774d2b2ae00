// Rule 53: a believed free variable keeps its value within one plan, and is free for the next.
!s.
+!s <-
    +any(Z, 2);
    if (any(1, 2)) { .print("any(1,2)") };
    if (any(foo, 2)) { .print(never) } else { .print("foo is not 1") };
    !other; !context(foo); !context(bar);
    ?asked(5); ?asked(6); .print("a rule asks anew each time");
    if (not any(7, 2)) { .print("still 1 here") };
    .findall(X, any(X, 2), L); .print(L);
    -any(1, _); if (any(_, 2)) { .print("no fact any(1,2) was there") }.
+any(X, Y) <- .print("event ", Y).
+!other <- ?any(3, 2); .print(3); if (any(4, 2)) { .print(never) }.
+!context(X) : any(X, 2) & not any(zip, 2) <- .print("context ", X); if (any(1, 2)) { .print(never) }.
asked(X) :- any(X, 2) & not any(X + 1, 2).
