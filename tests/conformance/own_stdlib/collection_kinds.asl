// A free variable becomes a map or set on first use; other kinds of collection or term fail; contents are kept in order.
// Expected from the specification, not recorded from Jason.
!start.
+!start <- for (.range(I, 1, 18)) { !t(I) }.
+!t(1) <- .map.put(M, a, 1); .map.get(M, a, V); .print(V, M).
+!t(2) <- .set.add(S, b); .set.add(S, a); .set.add(S, b); .print(S).
+!t(3) <- .queue.add(Q, a); .print("not here").
+!t(4) <- .set.to_list(S, L); .print(L).
+!t(5) <- .set.to_list([b,a], L); .print("not here").
+!t(6) <- .map.put([], a, 1); .print("not here").
+!t(7) <- .map.create(M); .set.add(M, a); .print("not here").
+!t(8) <- .set.create(S); .map.clear(S); .print("not here").
+!t(9) <- .queue.create(Q, other); .queue.add_all(Q, [b,a]); .print(Q).
+!t(10) <- .queue.create(Q, priority); .queue.add_all(Q, [p(2,a),p(1,b),p(2,b),0]); .print(Q).
+!t(11) <- .map.create(M); .map.create(M); .print("not here").
+!t(12) <- .set.create(S); .set.add_all(S, [f(2),"s",[1],f(1),3,~a,a]); .set.remove(S, "s"); .set.remove(S, zz); .print(S).
+!t(13) <- .set.create(S); .set.add_all(S, [c,a,b]); .set.create(T); .set.add_all(T, [d,b,c]);
           .set.intersection(S, T); .print(S); .set.union(S, [z,y]); .print(S); .set.difference(S, T); .print(S).
+!t(14) <- .map.create(M); .map.put(M, k, v); .map.remove(M, k, x); .print("not here").
+!t(15) <- .map.create(M); .map.put(M, 1, x); .map.get(M, 1.0, V); .print(V).
+!t(16) <- .map.create(M); .map.get(M, k, V, none); .print(V).
+!t(17) <- .queue.create(Q); .queue.add(Q, a); .queue.copy(Q, R); .queue.remove(R, _); .length(Q, N); .length(R, K); .print(N, K).
+!t(18) <- .map.create(M); .map.put(M, M2, 1); .map.put(M, f(X), 2); .length(M, N); .print(N).
-!t(N)[error(E)] <- .print(N, " ", E).
