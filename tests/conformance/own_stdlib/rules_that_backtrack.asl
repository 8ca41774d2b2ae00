// A rule keeps what its first formulas have bound while its later ones are backtracked into, whoever asks.
// Expected from the specification, not recorded from Jason.
b(1). b(2).
pair(X, Y) :- .member(X, [1,2]) & b(Y).
order(X, Y) :- .range(X, 1, 3) & .range(Y, X, 3) & not X == Y.
deep(X, Y, Z) :- pair(X, Y) & .member(Z, [X,Y]) & b(Z).
in(f(X, Y)) :- .member(X, [1,2]) & pair(X, Y).
!start.
+!start
   <- .findall(p(X,Y), pair(X, Y), L); .print(L);
      .findall(p(X,Y), pair(X, Y), L2); .print(L2);
      for (order(A, B)) { .print(A, " ", B) };
      .findall(d(C,D,E), deep(C, D, E), L3); .print(L3);
      .findall(F, in(F), L4); .print(L4); .findall(G, in(f(2, G)), L5); .print(L5);
      Q = pair(H, I); .findall(H-I, Q, L6); .print(L6);
      .count(pair(J, _) & pair(J, _), N); .print(N);
      if (pair(K, M) & K > M) { .print(K, M) };
      .send(bob, askAll, pair(_, _), R); .print(R);
      !g(O, P).
+!g(S, T) : pair(S, T) & S + T == 4 <- .print(S, T).
