// Triggers of every namespace, this_ns before a variable, and brackets in all places where formulas stand.
!start.
+!N::open(N) <- .print("same ", N).
+!N::open(X) <- .print("open ", X, " of ", N).
+!start <- !lab::open(lab); !zoo::open(3); !open(4); .relevant_plans({+!qq::open(1)}, L); .length(L,K); .print(K); .add_plan({+!M::close <- .print(closing, M)}); !bar::close; !close; this_ns::X = 3; .print(X);
   P = {+!go <- .print(this_ns)}; +P; !go; !brackets; !foo::unknown.
-!N::unknown[error(E)] <- .print(N, E).
+!brackets <- if (true) { (X = 3; !double(X, Y)); .print(X, " ", Y) }; .print(X, " ", Y);
   for (.member(K, [1,2])) { (Z = K; .print(Z)); ({ W = Z }; .print(W)) };
   (A = 1; (B = A + 1; (C = B + 1))) ||| (.wait(50); D = 7); .print(A, B, C);
   P = { Q = 5; .print(Q) }; P; (P; .print(Q)); ( .fail ).
+!double(X, 2 * X).
-!brackets[code_line(L)] <- .print("failed in line ", L).
