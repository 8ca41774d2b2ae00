// Questions to nobody, to a list with an unknown member, to oneself and others. (the part of alice)
// order: per-agent
v(1).
!go.
+!go
   <- .send([], askOne, v(_), A); .print(A);
      !t(1); !t(2); !t(3); !t(4); !t(5); !t(6); !t(7); !t(8); !t(9);
      .wait(300); if (not slow(_)) { .print("late answers are gone") } .stopMAS.
+!t(1) <- .send([bob,nobody], askOne, v(_), A); .print("not here").
+!t(2) <- .send([bob,alice], askOne, v(_), L); .sort(L, S); .print(S).
+!t(3) <- .send(bob, askOne, slow(_), A, 100); .print(A); .send(bob, askOne, v(_), B); .print(B).
+!t(4) <- .send([bob,alice], askOne, slow(_), L, 100); .print(L).
+!t(5) <- .send(bob, askOne, broken(_), A, 100); .print(A).
+!t(6) <- .send(bob, askOne, tested(_), A); .print(A).
+!t(7) <- .send(bob, askOne, ~w(_), ~w(X)); .print(X).
+!t(8) <- .send(bob, askAll, v(_), [v(X)|_]); .print(X).
+!t(9) <- .send(bob, askAll, v(X) & X > 7, L, soon); .print("not here").
-!t(N)[error(E)] <- .print(N, " ", E).
