// Rule 64: true at the very start of a body, a block or a branch does nothing; later it is an action and fails.
!s.
+!s <-
    if (1 < 2) { true } else { .fail }; .print(a);
    for (.member(X, [1, 2])) { true; .print(X) };
    true_as_body.
-!s[code(C)] <- .print(C); B = { true; .print(b) }; B; true ||| .fail; .print(or); !t.
+!t <- true; .print(t); if (1 < 2) { .print(u); true }; .print(never).
-!t[error(E), code(C)] <- .print(E, " ", C).
