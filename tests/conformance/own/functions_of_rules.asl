// Rule 16: functions made of rules, in arithmetic, arguments, conditions and lists.
{ register_function("f.sq", 1, "sq") }
{ register_function("f.add", 2, "add") }
sq(X, R) :- R = X * X.
add(A, B, C) :- C = A + B.
!s. +!s <- X = f.sq(4) + f.add(1, 2) * 2; .print(X); +c(f.sq(5)); ?c(Y); .print(Y); if (f.sq(2) == 4 & f.add(1, f.sq(2)) > 4) { .print(ok) }; !g(f.sq(2)); L = [f.sq(1), f.add(1, 1)]; .print(L); .print(f.sq(a)); W = math.max(f.sq(2), 3); .print(W); .print(math.abs(-3), " ", math.floor(2.7), " ", math.sqrt(16), " ", math.pi > 3); T = math.round(2.5) + math.ceil(1.1); .print(T).
+!g(X) : X = f.add(2, 2) <- .print(g, X).
