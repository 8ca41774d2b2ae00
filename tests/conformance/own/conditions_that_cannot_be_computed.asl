// An error of an internal action in a condition makes it false.
r(X) :- .nth(9,[a],X).
!s. +!s <- if (.nth(9,[a],X)) { .print(no) } else { .print("else") }; while (.nth(9,[a],Y)) { .print(no) }; for (.nth(9,[a],Z)) { .print(no) }; if (not .nth(9,[a],W)) { .print("not") }; if (r(Q)) { .print(no) } else { .print(rule) }; if (.member(V, 5) | 1 < 2) { .print(or) }; .findall(K, .member(K, 5), L); .print(L); !x.
+!x <- ?(.nth(9,[a],X) & a). -!x[error(E)] <- .print(E); !y. +!y : .nth(9,[a],X) <- .print(no). +!y <- .print(y); !z. +!z <- ?r(X). -!z[error(E)] <- .print(E).
