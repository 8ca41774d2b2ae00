// A function in a formula that a variable holds is computed when its variables have got their values.
// Expected from the specification, not recorded from Jason.
{ register_function("my.double", 1, "double") }
double(X, Y) :- Y = X * 2.
b(1). b(-4). b(3).
!start.
+!start
   <- Q = (b(X) & math.abs(X) > 2); .findall(X, Q, L); .print(L);
      P = (b(Z) & my.double(Z) + 1 < 0); if (P) { .print(Z) };
      W = (b(V) & math.max(V, 2) == 3); ?W; .print(V);
      S = (math.sum([1,a,2]) == 3 & not math.abs(x) == 1); if (S) { .print("computed at once") }.
