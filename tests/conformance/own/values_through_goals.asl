// Rules 59, 73 and 91: values that come back through goals, structures, contexts and annotations.
v(5).
!s.
+!s <-
    !f(X, Y, Z); .print(X, Y, Z); !g([A|T]); .print(A, T); !h(p(Q)); .print(Q);
    !mk(P); P = p(B, C); B = 1; .print(P); !swap(p(1, 2), R); .print(R);
    !c(K, M); .print(K, M); !n(1)[r(W)]; .print(W); !u(U); .print(U).
+!f(A, A, B) <- B = A; A = 7.
+!g([1, 2, 3]).
+!h(P) <- P = p(z).
+!mk(p(_, _)).
+!swap(p(X, Y), p(Y, X)).
+!c(A, B) : v(B) & A = B + 1.
+!n(N)[r(Y)] <- Y = N + 1.
+!u(X) <- !w(X); X = 2.
+!w(1).
-!u(X) <- if (X == 1) { .print(never) }; X = 3.
