// An initial belief with variables goes by a deletion that is equal to it up to the names of its variables.
limit(_, 50). limit(road, 80). cost(X, X, 0). pair(A, B).
!s.
+!s <- -limit(path, 50); .count(limit(_, _), N1); .print(N1);
   -limit(K, 50); .count(limit(_, _), N2); .print(N2, " ", K);
   -cost(1, 1, 0); ?cost(2, 2, C); .print(C); -cost(Y, Z, 0); if (not cost(2, 2, _)) { .print("no cost") };
   -pair(V, V); ?pair(1, 2); .print("a pair"); -pair(_, _); if (not pair(_, _)) { .print("no pair") }.
