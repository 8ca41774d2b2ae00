// All kinds of code in braces print as they are written.
!s.
+!s <-
    X = { +b(1) }; .print(X); Y = { ?q(A) }; .print(Y); W = { h(B) :- c(B) & not d }; .print(W);
    V = { ^!g[state(S)] }; .print(V); U = { +!g : a | b <- .print("x y"); ?c }; .print(U);
    T = { if (a) { b } else { c } }; .print(T); R = { for (a(Z)) { b } }; .print(R);
    Q = { while (not a) { b; c } }; .print(Q); P = { a |&| b }; .print(P);
    O = { !!g; ++b; --c; +<d; +>e; -+f }; .print(O).
