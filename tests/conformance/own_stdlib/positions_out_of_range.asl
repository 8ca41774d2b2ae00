// Positions before the beginning, beyond the end and with fractions; kinds that are no position.
// Expected from the specification, not recorded from Jason.
!start.
+!start <- for (.range(I, 1, 16)) { !t(I) }.
+!t(1) <- .delete(-1, [a,b], R); .print(R).
+!t(2) <- .delete(-1, 1, [a,b,c], R); .print(R).
+!t(3) <- .delete(2, 9, "abcd", R); .print(R).
+!t(4) <- .delete(1.9, [a,b,c], R); .print(R).
+!t(5) <- .delete(a, 2, [a], R); .print("not here").
+!t(6) <- .delete(1, a, [a], R); .print("not here").
+!t(7) <- .delete(1, abc, R); .print("not here").
+!t(8) <- .delete(a, abc, R); .print("not here").
+!t(9) <- .nth(1.9, [a,b,c], X); .print(X).
+!t(10) <- .nth(3, "abc", X); .print("not here").
+!t(11) <- .nth(0/0, [a,b], X); .print(X).
+!t(12) <- .substring("abc", R, 4); .print("not here").
+!t(13) <- .substring("abc", R, 3); .print([R]).
+!t(14) <- .findall(X, .range(X, -1.5, 1.5), L); .print(L).
+!t(15) <- .range(a, 1, 3); .print("not here").
+!t(16) <- .findall(P, .substring("", "abc", P), L); .print(L).
-!t(N)[error(E)] <- .print(N, " ", E).
