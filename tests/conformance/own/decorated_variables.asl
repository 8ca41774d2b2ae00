// Rules 62 and 73: a variable with annotations, a sign or a namespace in a body is the literal it stands for, once it has a value.
!start.
+p(X)[A] <- .print("event ", A).
+?q(X)[how(H)] <- .print("asked ",X,H); X = 9.
+!g(X)[A|T] <- .print(X, A).
+!start <- B = p(1); +B[colour(red)]; ?B[colour(C)]; .print(C); Q = q(Z); ?Q[how(loud)]; .print(Z); G = g(1); !G[now]; N = ns1; X = r(2); +ns1::r(2); 
  ?N::r(K); .print(K); ?ns1::X; -B[colour(red)]; .print(end); if (B[colour(D)]) {.print(D)} else {.print(none)}; if (~X) {.print(no)}.
