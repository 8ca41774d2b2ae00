// Rule 101: everything in a namespace block belongs to it, default:: leaves it.
{ begin namespace(box) }
v(1). ~w(2).
r(X) :- v(X) & not ~w(X).
+!go(X) : v(X) <-
    .print(go, X); !sub; +v(5); ?v(Y); .print(Y);
    -+v(7); .findall(Z, v(Z), L); .print(L); ?r(Q); .print(Q);
    !default::go.
+!sub <- .print(sub).
+v(X) <- .print("+v ", X).
{ end }
!s.
+!s <- .wait(20); !box::go(1).
+!go <- .print("default go"); if (box::v(7)) { .print(seven) }; if (not v(_)) { .print(none) }.
